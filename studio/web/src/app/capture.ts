// Capture: frames as they come, what is clipped, what the meter said, what is missing.
import { api, type Capture, type Overview } from "./api";
import { h } from "./dom";
import { instruments } from "./instruments";
import type { Screen } from "./screens";

const BINS = 64;
const exposure = (seconds: number): string => (seconds >= 0.4 ? `${seconds} s` : `1/${Math.round(1 / seconds)} s`);

const clock = (offset?: number): string => (offset === undefined ? "" : Math.abs(offset) < 1 ? "clock correct" : `clock ${Math.abs(offset).toFixed(0)} s ${offset > 0 ? "fast" : "slow"}`);

/** A histogram of a frame's brightest channel; the last bin is what is clipped. */
function histogram(image: HTMLImageElement, onto: HTMLCanvasElement): void {
  const small = h("canvas", { width: 160, height: Math.max(1, Math.round((160 * image.naturalHeight) / image.naturalWidth)) });
  const context = small.getContext("2d", { willReadFrequently: true })!;
  context.drawImage(image, 0, 0, small.width, small.height);
  const { data } = context.getImageData(0, 0, small.width, small.height);
  const counts = new Float64Array(BINS);
  for (let i = 0; i < data.length; i += 4) counts[Math.floor((Math.max(data[i]!, data[i + 1]!, data[i + 2]!) * BINS) / 256)]! += 1;
  const most = Math.max(...counts);
  const to = onto.getContext("2d")!;
  to.clearRect(0, 0, onto.width, onto.height);
  counts.forEach((count, i) => {
    const tall = onto.height * Math.sqrt(count / most);
    to.fillStyle = i === BINS - 1 ? "#e5484d" : "#9aa3a0";
    to.fillRect((i * onto.width) / BINS, onto.height - tall, onto.width / BINS, tall);
  });
}

export async function captureScreen(session: Overview): Promise<Screen> {
  const verdict = h("p", { class: "verdict", "data-part": "verdict", role: "status" });
  const facts = h("dl", { class: "figures" });
  const frames = h("div", { class: "frames" });
  const shown = new Map<string, HTMLElement>();
  const rigs = session.status === "complete" || session.simulated ? null : instruments();
  rigs?.again("");

  function fact(name: string, text: string): HTMLElement {
    return h("div", {}, h("dt", {}, name), h("dd", {}, text));
  }

  function tile(file: string, text: string): HTMLElement {
    const bars = h("canvas", { width: 160, height: 36, "aria-hidden": "true" });
    const image = h("img", { src: api.frame(session.name, file), alt: text, load: (event: Event) => histogram(event.target as HTMLImageElement, bars) });
    return h("figure", { "data-file": file }, image, bars, h("figcaption", {}));
  }

  function show(now: Capture): void {
    const complete = now.status === "complete";
    const stops = now.bracket.stops_s;
    const one = now.bracket.mode === "panorama";
    verdict.textContent = one ? "One panorama: no brackets, no meter" : complete ? `Complete: ${now.frames.length} frames` : `Partial: ${now.missing.join(", ") || "capture in progress"}`;
    verdict.classList.toggle("bad", !complete);
    const readings = now.readings.map((one) => `${one.when}: ${one.luminance_cd_m2 === undefined ? one.status : `${one.luminance_cd_m2.toPrecision(4)} cd/m²`}`);
    const late = now.warnings.filter((one) => one.code === "start_skew").length;
    const clipped = now.frames.filter((one) => (one.statistics?.clipped_frac ?? 0) > 0.5).length;
    facts.replaceChildren(
      ...now.devices.map((one) => fact(one.role, [`${one.model}${one.simulated ? " (simulated)" : ""}`, one.lens, one.nd_filter, clock(one.clock_offset_s)].filter(Boolean).join(" · "))),
      ...(stops.length ? [fact("Plan", `${stops.length} stops per camera, ${exposure(Math.max(...stops))} to ${exposure(Math.min(...stops))}: total exposure ${stops.reduce((sum, s) => sum + s, 0).toFixed(0)} s`)] : []),
      ...(one ? [] : [fact("Readings", readings.join(", ") || "no reading yet")]),
      ...(now.drift_frac === undefined ? [] : [fact("Light drift", `${(100 * now.drift_frac).toFixed(1)} %`)]),
      ...(one ? [] : [fact("Frames", `${now.frames.length} of ${now.bracket.sides.length * stops.length}${clipped ? `, ${clipped} mostly clipped` : ""}`)]),
      ...(one || now.bracket.mode === "imported" || !now.frames.some((frame) => frame.side !== now.frames[0]!.side) ? [] : [fact("Shutters", late ? `${late} of ${stops.length} pairs opened further apart than the rig allows` : "every pair opened within the rig's limit")]),
      ...(now.warnings.length ? [fact("Warnings", now.warnings.map((one) => one.message).join("; "))] : []));
    for (const one of [...now.frames].sort((a, b) => a.side.localeCompare(b.side) || a.stop - b.stop)) {
      const seconds = now.bracket.stops_s[one.stop];
      const text = `${one.side}, ${seconds === undefined ? one.file : exposure(seconds)}`;
      const box = shown.get(one.file) ?? tile(one.file, text);
      const share = one.statistics === undefined ? "" : ` · ${(100 * one.statistics.clipped_frac).toFixed(1)} % clipped`;
      box.querySelector("figcaption")!.textContent = text + share;
      shown.set(one.file, box);
      frames.append(box);
    }
  }

  const refresh = async (): Promise<void> => show(await api.capture(session.name));
  await refresh();
  return {
    element: h("section", { class: "wide" }, verdict, facts, rigs && h("details", { open: true }, h("summary", {}, "Instruments now"), rigs.element), frames,
      session.frames ? null : h("img", { class: "whole", src: api.picture(session.name, "Card", 2048, session.stamp), alt: "The panorama as imported", error: (event: Event) => (event.target as Element).remove() })),
    refresh,
    run: { until: "report", text: "Process this session" },
    command: session.status === "complete" ? `daylit process ${session.path}` : `daylit capture --resume ${session.path}`,
  };
}
