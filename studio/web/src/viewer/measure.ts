// Region and ruler on a panorama: what the light in a rectangle of directions is, how far two places are apart.
import { quantityText } from "./encoding";
import { type PanoramaView, RAD } from "./panorama";
import type { Region } from "./probe";

export type Direction = readonly [longitude: number, latitude: number];
type Place = readonly [x: number, y: number, z: number];

/** The room that a ruler measures in: corners of its floor counter-clockwise, camera above the first, all in metres. */
export interface Room {
  floor: readonly (readonly [number, number])[];
  camera_m: number;
  ceiling_m: number;
}

/** An angle between -180 and 180 degrees. */
export const turned = (degrees: number): number => ((((degrees + 180) % 360) + 360) % 360) - 180;

/** Where a ray from the camera meets floor, ceiling or a wall, relative to the camera; null where no wall stands. */
export function placeIn(room: Room, [longitude, latitude]: Direction): Place | null {
  const [dx, dy, dz] = [Math.sin(longitude * RAD), Math.cos(longitude * RAD), Math.tan(latitude * RAD)];
  let away = Infinity;
  room.floor.forEach(([x0, y0], i) => {
    const [x1, y1] = room.floor[(i + 1) % room.floor.length]!;
    const [side, ahead, area] = [dx * y0 - dy * x0, dx * y1 - dy * x1, x0 * y1 - y0 * x1];
    if (side <= 0 && ahead > 0 && area > 0) away = Math.min(away, area / (ahead - side));
  });
  const [low, high] = [-room.camera_m, room.ceiling_m - room.camera_m];
  if (away * dz < low) away = low / dz;
  if (away * dz > high) away = high / dz;
  return Number.isFinite(away) ? [away * dx, away * dy, away * dz] : null;
}

export const clippedText = (share: number): string => (share > 0 ? ` · ${(100 * share).toPrecision(2)} % clipped: values may be higher` : "");

export function regionText(region: Region, unit: string): { value: string; detail: string } {
  if (!region.steradians) return { value: "no value", detail: "region without light" };
  const short = (value: number): string => quantityText(value, NaN);
  const unknown = region.unknown > 0.005 ? ` · ${(100 * region.unknown).toFixed(0)} % without a value` : "";
  return {
    value: `mean ${short(region.mean)} ${unit}`,
    detail: `${short(region.lowest)} to ${short(region.highest)} · standard deviation ${short(region.deviation)} · ${short(region.steradians)} sr${unknown}${clippedText(region.clipped)}`,
  };
}

/** How far two places of the room are apart, with the parts along and up. */
export function rulerText(room: Room, from: Direction, to: Direction): { value: string; detail: string } {
  const [a, b] = [placeIn(room, from), placeIn(room, to)];
  if (!a || !b) return { value: "no surface there", detail: "the ruler measures on floor, walls and ceiling" };
  const [level, up] = [Math.hypot(a[0] - b[0], a[1] - b[1]), Math.abs(a[2] - b[2])];
  return {
    value: `${Math.hypot(level, up).toFixed(2)} m`,
    detail: `${level.toFixed(2)} m horizontal, ${up.toFixed(2)} m vertical · on the estimated room surfaces; objects in front of them are nearer`,
  };
}

/** Outline to draw: directions along the region's sides, or along the line between two places. */
export function outline(kind: string, room: Room | null, from: Direction, to: Direction): Direction[] {
  const shares = Array.from({ length: 13 }, (_, i) => i / 12);
  if (kind === "ruler" && room) {
    const [a, b] = [placeIn(room, from), placeIn(room, to)];
    if (!a || !b) return [from, to];
    const between = shares.map((s) => a.map((v, i) => v + s * (b[i]! - v)));
    return between.map(([x, y, z]) => [Math.atan2(x!, y!) / RAD, Math.atan2(z!, Math.hypot(x!, y!)) / RAD]);
  }
  const [across, up] = [turned(to[0] - from[0]), to[1] - from[1]];
  const corners = [[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]] as const;
  return corners.slice(1).flatMap(([u, v], i) =>
    shares.map((s): Direction => [from[0] + across * (corners[i]![0] * (1 - s) + u * s), from[1] + up * (corners[i]![1] * (1 - s) + v * s)]));
}

/** SVG points of directions that lie before the viewer. */
export function drawnPoints(view: PanoramaView, along: Direction[]): string {
  const places = along.map(([longitude, latitude]) => {
    const flat = Math.cos(latitude * RAD);
    return view.placeOf([flat * Math.sin(longitude * RAD), flat * Math.cos(longitude * RAD), Math.sin(latitude * RAD)]);
  });
  return places.flatMap((at) => (at ? [`${at[0].toFixed(1)},${at[1].toFixed(1)}`] : [])).join(" ");
}
