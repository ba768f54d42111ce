// Reads a state's numbers at a direction: one pixel of the picture on disk, and what it is worth.
import { luminance, quantityText, type Size, uncertainty, unpacked } from "./encoding";
import { type Direction, turned } from "./measure";

/** Maps of single pixels of a picture on disk. */
export interface Maps {
  luminance: string;
  uncertainty: string;
  validity: string;
  map_px: Size;
  picture_px: Size;
}

export interface Reading {
  luminance: number;
  relativeUncertainty: number;
  worth: string;
  x: number;
  y: number;
}

/** Luminance between two directions, by solid angle; NaN where nothing has a value. */
export interface Region {
  mean: number;
  median: number;
  lowest: number;
  highest: number;
  deviation: number;
  /** Of its mean, standard: what the pixels state, taken for shared by all. */
  relativeUncertainty: number;
  /** Solid angle of what has a value; share of it that is clipped, so that values may be higher; share of all that has none. */
  steradians: number;
  clipped: number;
  unknown: number;
  /** Of the picture on disk: left, top, right, bottom; null across its edge. */
  box_px: [number, number, number, number] | null;
}

export interface Probe {
  /** Codes of luminance, row by row. */
  luminance: Uint16Array;
  /** What stands at a longitude and latitude, degrees. */
  at(longitude: number, latitude: number): Reading;
  within(from: Direction, to: Direction): Region;
}

const CLIPPED = 1;
const WORTH = ["", "clipped: at least this", "too dark to be accurate", "outside the lens's field of view", "repaired: a modelled value"];

type Pixel = { value: number; margin: number; area: number; clipped: boolean };
const areaOf = (of: Pixel[]): number => of.reduce((sum, { area }) => sum + area, 0);

/** Median by solid angle, NaN of none. */
function middle(of: Pixel[], key: "value" | "margin"): number {
  const known = of.filter((one) => !Number.isNaN(one[key])).sort((a, b) => a[key] - b[key]);
  let left = areaOf(known) / 2;
  return known.find(({ area }) => (left -= area) <= 0)?.[key] ?? NaN;
}

export async function openProbe(maps: Maps): Promise<Probe> {
  const [light, margin, validity] = await Promise.all([
    unpacked(maps.luminance, maps.map_px, 2),
    unpacked(maps.uncertainty, maps.map_px, 1),
    unpacked(maps.validity, maps.map_px, 1),
  ]);
  const [width, height] = maps.map_px;
  const [wide, high] = maps.picture_px;
  const row = (latitude: number): number => (0.5 - latitude / 180) * height;
  return {
    luminance: light as Uint16Array,
    within(from, to) {
      const across = turned(to[0] - from[0]);
      const x0 = Math.floor((turned(Math.min(from[0], from[0] + across)) / 360 + 0.5) * width);
      const columns = Math.max(1, Math.round((Math.abs(across) / 360) * width));
      const y0 = Math.min(height - 1, Math.floor(row(Math.max(from[1], to[1]))));
      const y1 = Math.max(y0 + 1, Math.ceil(row(Math.min(from[1], to[1]))));
      const found: Pixel[] = [];
      let all = 0;
      for (let y = y0; y < y1; y += 1) {
        const area = ((2 * Math.PI) / width) * (Math.sin((0.5 - y / height) * Math.PI) - Math.sin((0.5 - (y + 1) / height) * Math.PI));
        all += columns * area;
        for (let i = 0; i < columns; i += 1) {
          const at = y * width + ((x0 + i) % width);
          const value = luminance(light[at]!);
          if (!Number.isNaN(value)) found.push({ value, margin: uncertainty(margin[at]!), area, clipped: validity[at] === CLIPPED });
        }
      }
      const steradians = areaOf(found);
      const meanOf = (of: (one: Pixel) => number): number => found.reduce((sum, one) => sum + of(one) * one.area, 0) / steradians;
      const mean = meanOf(({ value }) => value);
      const box = [x0 * wide / width, y0 * high / height, (x0 + columns) * wide / width, y1 * high / height].map(Math.round);
      return {
        mean, median: middle(found, "value"), deviation: Math.sqrt(meanOf(({ value }) => (value - mean) ** 2)),
        lowest: found.reduce((least, { value }) => Math.min(least, value), Infinity), highest: found.reduce((most, { value }) => Math.max(most, value), 0),
        relativeUncertainty: middle(found, "margin"), steradians, clipped: meanOf((one) => Number(one.clipped)), unknown: 1 - steradians / all,
        box_px: x0 + columns <= width ? (box as [number, number, number, number]) : null,
      };
    },
    at(longitude, latitude) {
      const turns = (longitude / 360 + 0.5) % 1;
      const column = Math.min(width - 1, Math.floor((turns < 0 ? turns + 1 : turns) * width));
      const row = Math.max(0, Math.min(height - 1, Math.floor((0.5 - latitude / 180) * height)));
      const index = row * width + column;
      return {
        luminance: luminance(light[index]!),
        relativeUncertainty: uncertainty(margin[index]!),
        worth: WORTH[validity[index]!] ?? "",
        x: Math.floor(((column + 0.5) * wide) / width),
        y: Math.floor(((row + 0.5) * high) / height),
      };
    },
  };
}

/** A reading in words: value, uncertainty and unit; then where, and what it is worth. */
export function readingText(reading: Reading, longitude: number, latitude: number, unit: string): { value: string; detail: string } {
  const where =
    `${Math.abs(longitude).toFixed(1)}° ${longitude < 0 ? "left" : "right"}, ` +
    `${Math.abs(latitude).toFixed(1)}° ${latitude < 0 ? "down" : "up"} · pixel ${reading.x}, ${reading.y}`;
  const share = reading.relativeUncertainty;
  const percent = Number.isNaN(share) ? "uncertainty unknown" : `± ${(100 * share).toPrecision(2)} %`;
  const known = !Number.isNaN(reading.luminance);
  return {
    value: known ? `${quantityText(reading.luminance, share * reading.luminance)} ${unit}` : "no value",
    detail: [known ? percent : "", reading.worth, where].filter(Boolean).join(" · "),
  };
}
