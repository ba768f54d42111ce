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

export interface Probe {
  /** Codes of luminance, row by row. */
  luminance: Uint16Array;
  /** What stands at a longitude and latitude, degrees. */
  at(longitude: number, latitude: number): Reading;
}

const WORTH = ["", "clipped: at least this", "too dark to be exact", "outside the lens's field", "repaired: a model's value"];

export async function openProbe(maps: Maps): Promise<Probe> {
  const [light, margin, validity] = await Promise.all([
    unpacked(maps.luminance, maps.map_px, 2),
    unpacked(maps.uncertainty, maps.map_px, 1),
    unpacked(maps.validity, maps.map_px, 1),
  ]);
  const [width, height] = maps.map_px;
  const [wide, high] = maps.picture_px;
  return {
    luminance: light as Uint16Array,
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
