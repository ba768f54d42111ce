// Reads a state's numbers at a direction: one pixel of the picture on disk, and what it is worth.
import { luminance, quantityText, type Size, uncertainty, unpacked } from "./encoding";

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

export interface Region {
  mean: number;
  median: number;
  lowest: number;
  highest: number;
  /** Of its mean, standard: what the pixels state, taken for shared by all. */
  relativeUncertainty: number;
  /** Share of its solid angle that is clipped: values are then lower bounds. */
  clipped: number;
  /** Of the picture on disk: left, top, right, bottom; null across its edge. */
  box_px: [number, number, number, number] | null;
}

export interface Probe {
  /** Codes of luminance, and what they are worth, row by row. */
  luminance: Uint16Array;
  validity: Uint8Array;
  /** What stands at a longitude and latitude, degrees. */
  at(longitude: number, latitude: number): Reading;
  /** Luminance within longitudes and latitudes, degrees, by solid angle; null where there is no value. It may go across the picture's edge. */
  within(left: number, top: number, right: number, bottom: number): Region | null;
}

export const CLIPPED = 1;
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
  const column = (longitude: number): number => Math.round(((((longitude / 360 + 0.5) % 1) + 1) % 1) * width) % width;
  const row = (latitude: number): number => Math.round((0.5 - latitude / 180) * height);
  return {
    luminance: light as Uint16Array,
    validity: validity as Uint8Array,
    within(left, top, right, bottom) {
      const [x0, x1, y0, y1] = [column(left), column(right), Math.max(0, row(top)), Math.min(height, row(bottom))];
      const found: Pixel[] = [];
      for (let y = y0; y < y1; y += 1)
        for (let x = x0; x !== x1; x = (x + 1) % width) {
          const at = y * width + x;
          const one = { value: luminance(light[at]!), margin: uncertainty(margin[at]!), area: Math.cos((0.5 - (y + 0.5) / height) * Math.PI), clipped: validity[at] === CLIPPED };
          if (!Number.isNaN(one.value)) found.push(one);
        }
      if (!found.length) return null;
      const scale = [wide / width, high / height, wide / width, high / height];
      return {
        mean: found.reduce((sum, { value, area }) => sum + value * area, 0) / areaOf(found), median: middle(found, "value"),
        lowest: found.reduce((least, { value }) => Math.min(least, value), Infinity), highest: found.reduce((most, { value }) => Math.max(most, value), 0),
        relativeUncertainty: middle(found, "margin"), clipped: areaOf(found.filter((one) => one.clipped)) / areaOf(found),
        box_px: x0 < x1 ? ([x0, y0, x1, y1].map((v, i) => Math.round(v * scale[i]!)) as [number, number, number, number]) : null,
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
