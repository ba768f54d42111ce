// Edges of the picture beside an edge of a window or door: it is drawn to where the picture shows it.
import type { Opening, Room } from "./api";
import { onWall, ray } from "./rooms";

const WIDTH_PX = 2048;
/** How far an edge is drawn, in steps; from how far to both sides the step of brightness is taken. Metres. */
const REACH_M = 0.12;
const STEP_M = 0.004;
const SIDE_M = 0.018;
const SAMPLES = 40;
/** Of the code range: a weaker step of brightness is no edge. */
const LEAST_STEP = 9;
/** Times what edges beside it show: less stands out from nothing. */
const STANDS_OUT = 1.7;

export class Edges {
  private readonly grey: Float32Array;

  constructor(picture: HTMLImageElement) {
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [WIDTH_PX, WIDTH_PX / 2];
    const context = canvas.getContext("2d", { willReadFrequently: true })!;
    context.drawImage(picture, 0, 0, canvas.width, canvas.height);
    const { data } = context.getImageData(0, 0, canvas.width, canvas.height);
    this.grey = Float32Array.from({ length: data.length / 4 }, (_, i) => 0.3 * data[4 * i]! + 0.6 * data[4 * i + 1]! + 0.1 * data[4 * i + 2]!);
  }

  /** The opening with the edges of a corner (0: start and sill, 1: end and sill, 2: end and head, 3: start and head) where the picture has them. */
  snapped(room: Room, opening: Opening, corner: number): Partial<Opening> {
    const across = corner === 0 || corner === 3 ? "start_m" : "end_m";
    const level = corner < 2 ? "sill_m" : "head_m";
    const { wall, start_m, end_m, sill_m, head_m } = opening;
    // Corners are left out: there the other edge is seen.
    const inner = (from: number, to: number, k: number): number => from + (to - from) * (0.1 + (0.8 * k) / (SAMPLES - 1));
    const upright = this.best(opening[across], (place, k) => this.at(room, wall, place, inner(sill_m, head_m, k)));
    const flat = this.best(opening[level], (place, k) => this.at(room, wall, inner(start_m, end_m, k), place));
    return { [across]: upright, ...(level === "sill_m" && opening.kind !== "window" ? {} : { [level]: flat }) };
  }

  private best(given: number, sample: (place: number, k: number) => number): number {
    const count = Math.round(REACH_M / STEP_M);
    const strengths: number[] = [];
    let [place, most] = [given, 0];
    for (let step = -count; step <= count; step += 1) {
      const here = given + step * STEP_M;
      let sum = 0;
      for (let k = 0; k < SAMPLES; k += 1) sum += sample(here + SIDE_M, k) - sample(here - SIDE_M, k);
      const strength = Math.abs(sum) / SAMPLES;
      strengths.push(strength);
      const worth = strength * (1 - 0.4 * Math.abs(step / count));
      if (strength > LEAST_STEP && worth > most) [place, most] = [here, worth];
    }
    const usual = strengths.sort((a, b) => a - b)[Math.floor(strengths.length / 2)]!;
    return most > STANDS_OUT * usual ? place : given;
  }

  /** Brightness of a place on a wall. */
  private at(room: Room, wall: number, along: number, height: number): number {
    const [x, y, z] = ray(room, onWall(room, wall, along), height);
    const u = (Math.atan2(x, y) / (2 * Math.PI) + 0.5) * WIDTH_PX - 0.5;
    const v = (0.5 - Math.atan2(z, Math.hypot(x, y)) / Math.PI) * (WIDTH_PX / 2) - 0.5;
    const [left, top] = [Math.floor(u), Math.max(0, Math.min(WIDTH_PX / 2 - 2, Math.floor(v)))];
    const [a, b] = [u - left, v - top];
    const one = (column: number, row: number): number => this.grey[row * WIDTH_PX + ((column + WIDTH_PX) % WIDTH_PX)]!;
    return (1 - b) * ((1 - a) * one(left, top) + a * one(left + 1, top)) + b * ((1 - a) * one(left, top + 1) + a * one(left + 1, top + 1));
  }
}
