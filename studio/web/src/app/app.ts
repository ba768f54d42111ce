// The frame around the screens: where one is, what runs, undo, and the command line that does the same.
import { api, type Card, type Job, type Overview } from "./api";
import { dropZone } from "./bring";
import { button, h, note } from "./dom";
import { instruments } from "./instruments";
import type { Screen } from "./screens";

/** Each is loaded when it is first opened: the list of sessions needs none of them. */
const SCREENS: Record<string, { title: string; needs: string; open: (session: Overview) => Promise<Screen> }> = {
  capture: { title: "Capture", needs: "frames", open: async (session) => (await import("./capture")).captureScreen(session) },
  room: { title: "Room", needs: "room", open: async (session) => (await import("./room")).roomScreen(session) },
  remove: { title: "Remove", needs: "detect", open: async (session) => (await import("./remove")).removeScreen(session) },
  furnish: { title: "Furnish", needs: "arrange", open: async (session) => (await import("./furnish")).furnishScreen(session) },
  light: { title: "Light", needs: "materials", open: async (session) => (await import("./light")).lightScreen(session) },
  results: { title: "Results", needs: "calibrate", open: async (session) => (await import("./results")).resultsScreen(session) },
};

const [top, main, below] = ["top", "screen", "below"].map((id) => document.getElementById(id)!) as [HTMLElement, HTMLElement, HTMLElement];
let screen: Screen | null = null;
let events: EventSource | null = null;
let opening = 0;

function close(): void {
  screen?.close?.();
  events?.close();
  screen = events = null;
}

async function route(): Promise<void> {
  const mine = (opening += 1);
  close();
  main.replaceChildren(h("p", { class: "facts" }, "Opening …"));
  below.replaceChildren();
  const [name, kind] = location.hash.slice(2).split("/").map(decodeURIComponent);
  try {
    if (name) await session(name, kind ?? "", mine);
    else await sessions(mine);
  } catch (error) {
    if (mine !== opening) return;
    main.replaceChildren(h("p", { class: "verdict bad" }, (error as Error).message));
  }
  if (mine === opening) main.dataset.ready = location.hash;
}

async function sessions(mine: number): Promise<void> {
  top.replaceChildren(h("h1", {}, "Sessions"));
  const found = await api.sessions();
  if (mine !== opening) return;
  const cards = found.sessions.map(card);
  const command = new Text("");
  const news = h("div", { class: "news" }, starter(found.folder, found.sessions, command), dropZone(found.folder, (text) => (command.data = text)));
  main.replaceChildren(cards.length ? h("ul", { class: "cards" }, ...cards) : h("p", { class: "empty" }, "No sessions yet: capture a room or import a panorama."), news);
  below.replaceChildren(h("p", {}, "On the command line: ", h("code", {}, command)));
}

/** What begins a capture, and goes to its screen as soon as there is something of it. */
function starter(folder: string, known: Card[], command: Text): HTMLElement {
  const room = h("input", { "aria-label": "Room name", placeholder: "room name", maxlength: 80, input: () => say() });
  const rig = h("select", { "aria-label": "Instruments", change: () => rigs.again(say()) },
    h("option", { value: "" }, "this computer's rig"), h("option", { value: "room" }, "simulated: a room"), h("option", { value: "uniform:100" }, "simulated: uniform light"));
  const words = h("p", { class: "facts", "data-part": "capturing", role: "status" });
  const start = button("Start a capture", () => void begin(), { class: "main" });
  const rigs = instruments();
  const world = (): string | null => rig.value || null;
  function say(): string {
    command.data = `daylit capture ${room.value ? JSON.stringify(room.value) : "ROOM"} --into ${folder}${world() ? ` --simulate ${world()} --size quarter --rate 4` : ""}`;
    return rig.value;
  }
  async function begin(): Promise<void> {
    start.disabled = true;
    try {
      await api.capturing({ room: room.value.trim(), simulate: world() });
      while (start.isConnected) {
        const { sessions: now, job } = await api.sessions();
        const fresh = now.find((one) => !known.some((old) => old.name === one.name));
        if (fresh) location.hash = `#/${encodeURIComponent(fresh.name)}/capture`;
        words.textContent = job?.running ? "Connecting to the instruments …" : "";
        if (fresh || !job?.running) {
          if (!fresh) note(`Capture did not start: ${job?.lines.at(-1) ?? ""}`, true);
          break;
        }
        await new Promise((done) => setTimeout(done, 700));
      }
    } catch (error) {
      note((error as Error).message, true);
    }
    start.disabled = false;
  }
  rigs.again(say());
  return h("section", { class: "starter" }, h("h2", {}, "Capture"), h("div", { class: "bar" }, room, rig, start), words, rigs.element);
}

function card(one: Card): HTMLElement {
  const stages = one.stages ?? [];
  const first = one.status !== "complete" || !stages.length ? "capture" : stages.includes("render") ? "results" : "room";
  const picture: HTMLElement = one.status === "damaged" ? h("div", { class: "blank" })
    : h("img", { src: api.picture(one.name, "Card", 640, ""), alt: "", loading: "lazy", error: () => picture.replaceWith(h("div", { class: "blank" })) });
  const state = one.status === "complete" ? (stages.includes("report") ? "processed" : stages.length ? `processed until ${["report", "render", "arrange", "remove", "detect", "room", "calibrate", "merge", "verify"].find((s) => stages.includes(s))}` : "captured") : one.status;
  return h("li", { class: "card" }, h("a", { href: `#/${encodeURIComponent(one.name)}/${first}` }, picture, h("strong", {}, one.title)),
    h("p", {}, [one.taken, state, one.simulated ? "simulated" : ""].filter(Boolean).join(" · ")),
    one.missing.length ? h("p", { class: "bad" }, `Missing: ${one.missing.slice(0, 4).join(", ")}${one.missing.length > 4 ? " …" : ""}`) : null);
}

async function session(name: string, kind: string, mine: number): Promise<void> {
  const found = await api.overview(name);
  if (mine !== opening) return;
  const chosen = tabs(found, kind);
  if (!chosen) throw new Error("This session has no results yet: process it");
  const opened = await SCREENS[chosen]!.open(found);
  if (mine !== opening) return opened.close?.();
  screen = opened;
  main.replaceChildren(opened.element);
  const job = h("div", { class: "job" });
  below.replaceChildren(job, h("p", {}, "On the command line: ", h("code", {}, opened.command)));
  showJob(job, found, found.job, opened);
  events = api.events(name);
  let stamp = found.stamp;
  events.addEventListener("message", (event: MessageEvent<string>) => {
    const now = JSON.parse(event.data) as { stamp: string; job: Job | null };
    showJob(job, found, now.job, opened);
    if (now.stamp === stamp) return;
    stamp = now.stamp;
    const again = async (): Promise<void> => {
      await opened.refresh?.();
      const fresh = await api.overview(name);
      if (mine === opening) tabs(fresh, chosen);
    };
    again().catch((error: unknown) => note((error as Error).message, true));
  });
}

/** Show the screens that there are results for; return the wanted one, else the first. */
function tabs(found: Overview, kind: string): string | undefined {
  const there = [...(found.stages ?? []), "frames"];
  const open = Object.entries(SCREENS).filter(([, one]) => there.includes(one.needs));
  const chosen = open.some(([id]) => id === kind) ? kind : open[0]?.[0];
  const links = open.map(([id, one]) =>
    h("a", { href: `#/${encodeURIComponent(found.name)}/${id}`, "aria-current": id === chosen ? "page" : null }, one.title));
  top.replaceChildren(h("a", { class: "home", href: "#/" }, "Sessions"), h("h1", {}, found.title), h("nav", { "aria-label": "Screens" }, ...links));
  top.querySelector("[aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" });
  return chosen;
}

function showJob(box: HTMLElement, { name, chosen: { quality: chosen = "standard" } }: Overview, job: Job | null, opened: Screen): void {
  const ask = (act: () => Promise<void>) => (): void => void act().catch((error: unknown) => note((error as Error).message, true));
  const children: Node[] = [];
  if (job?.running) {
    children.push(h("p", {}, h("span", { class: "busy", "aria-hidden": "true" }), `Running: ${job.lines.at(-1) ?? "starting"}`), button("Stop", ask(() => api.stop(name))));
  } else if (opened.run) {
    const { run } = opened;
    const quality = h("select", { "aria-label": "Quality" }, ...["draft", "standard", "reference"].map((one) => h("option", { selected: one === chosen }, one)));
    children.push(button(run.text, ask(() => api.run(name, "until" in run ? { until: run.until, quality: quality.value } : run.ask())), { class: "main" }));
    if ("until" in run) children.push(quality);
    if (job) children.push(h("p", { class: job.code ? "bad" : "" }, job.code ? `The last run failed: ${job.lines.at(-1)}` : "The last run is complete"));
  }
  if (job?.lines.length) children.push(h("details", {}, h("summary", {}, "Log"), h("pre", { tabindex: 0 }, job.lines.join("\n"))));
  box.dataset.state = job?.running ? "running" : job ? `ended ${job.code}` : "none";
  const open = box.querySelector("details")?.open;
  box.replaceChildren(...children);
  if (open) box.querySelector("details")?.setAttribute("open", "");
}

window.addEventListener("hashchange", () => void route());
window.addEventListener("keydown", (event) => {
  if (!(event.ctrlKey || event.metaKey) || event.key.toLowerCase() !== "z" || !screen) return;
  event.preventDefault();
  if (event.shiftKey) screen.redo?.();
  else screen.undo?.();
});
void route();
