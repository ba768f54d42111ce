// Light: the room at any hour of the year, measured where one points, and glare for somebody who sits in it.
import { quantityText } from "../viewer/encoding";
import { setUpPanorama, type State, type Widget } from "../viewer/widget";
import { api, factsOf, type Overview, type Point, type Room } from "./api";
import { markup, Regions } from "./box";
import { button, h, svg } from "./dom";
import { ARROWS, draggable, Plan } from "./plan";
import { onWall, round } from "./rooms";
import type { Screen } from "./screens";
import { Latest, Undo } from "./undo";

type Weather = "captured" | "clear" | "overcast";
const WEATHERS: Record<Weather, string> = { captured: "As captured", clear: "Clear sky", overcast: "Overcast" };
interface Moment {
  state: string;
  day: number;
  minute: number;
  weather: Weather;
  /** Where somebody sits, metres, and looks, degrees to the right of ahead; no place: at the camera. */
  seat: Point | null;
  azimuth: number;
}
interface Lit {
  captured: string;
  sun_elevation_deg: number;
  sun_azimuth_deg: number;
  global_horizontal_lx: number;
  median_luminance: number;
  sunny_share: number;
  uncertainty: number;
  unit: string;
  seconds: number;
}
type Figures = Record<string, { value: number; uncertainty: number }>;
interface Glare {
  figures: Figures;
  rating: string;
  faint: boolean;
  seen_share: number;
  sun_in_view: boolean;
}

const DAY_MS = 86_400_000;
const TURN_DEG = 15;
const two = (n: number): string => String(n).padStart(2, "0");
const clock = (minute: number): string => `${two(Math.floor(minute / 60))}:${two(minute % 60)}`;

export async function lightScreen(session: Overview): Promise<Screen> {
  const room = (await api.read<Room>(session.name, "room", async (answer) => (await answer.json()) as Room)).value;
  const states = session.states.filter((name) => name !== "Photograph");
  let year = new Date().getFullYear();
  let moment: Moment = { state: states[0] ?? "Emptied", day: 0, minute: 0, weather: "captured", seat: null, azimuth: 0 };
  let widget: Widget | null = null;
  let exposed = true;
  let kept = moment;
  const requests = new Latest();
  const seats = new Latest();
  const undo = new Undo<Moment>((before) => {
    moment = kept = before;
    controls();
    void light();
  });
  const command = new Text("");
  const box = h("div", { class: "result" });
  const facts = h("p", { class: "facts", "data-part": "facts", role: "status" }, "Computing the room's light: the first time takes a few seconds …");
  const glare = h("p", { class: "verdict", "data-part": "glare", role: "status" });
  const more = h("p", { class: "facts", "data-part": "glare-detail" });
  const date = (): Date => new Date(Date.UTC(year, 0, 1) + moment.day * DAY_MS);
  const local = (): string => `${date().toISOString().slice(0, 10)} ${clock(moment.minute)}`;
  const staged = (): number | null => (moment.state.startsWith("Staged") ? Number(moment.state.slice(7)) : null);
  const asked = (): object => ({ staged: staged(), at: local(), weather: moment.weather, exposed });

  const choice = h("select", { "aria-label": "State of the room", change: () => step({ state: choice.value }) }, ...states.map((name) => h("option", {}, name)));
  const weather = h("fieldset", { class: "segments" }, h("legend", { class: "unseen" }, "Weather"),
    ...Object.entries(WEATHERS).map(([name, text]) => h("label", {}, h("input", { type: "radio", name: "weather", value: name, change: () => step({ weather: name as Weather }) }), h("span", {}, text))));
  const slider = (label: string, most: number, by: number, set: (value: number) => Partial<Moment>): [HTMLInputElement, HTMLOutputElement] => [
    h("input", {
      type: "range", min: 0, max: most, step: by, "aria-label": label,
      input: (event: Event) => { moment = { ...moment, ...set(Number((event.target as HTMLInputElement).value)) }; controls(); void light(); },
      change: () => step({}),
    }), h("output", {})];
  const [time, timeText] = slider("Time of day", 1430, 10, (minute) => ({ minute }));
  const [day, dayText] = slider("Day of the year", 364, 1, (of) => ({ day: of }));
  const expose = h("input", { type: "checkbox", checked: true, change: () => { exposed = expose.checked; void light(); } });
  const bar = h("div", { class: "bar day" }, h("label", {}, "Room ", choice), weather,
    h("label", {}, "Time ", time, timeText), h("label", {}, "Day ", day, dayText), h("label", {}, expose, "Auto exposure"));

  function controls(): void {
    choice.value = moment.state;
    time.value = String(moment.minute);
    day.value = String(moment.day);
    for (const input of weather.querySelectorAll("input")) input.checked = input.value === moment.weather;
    timeText.textContent = clock(moment.minute);
    dayText.textContent = date().toLocaleDateString("en-GB", { day: "numeric", month: "long", timeZone: "UTC" });
    command.data = `daylit relight ${session.path} --at "${local()}" --weather ${moment.weather}${staged() ? ` --staged ${staged()}` : ""}`;
    drawSeat();
  }

  /** A choice is made: it can be undone. */
  function step(changed: Partial<Moment>): void {
    undo.step(kept);
    moment = kept = { ...moment, ...changed };
    controls();
    void light();
  }

  const light = (first = false): Promise<void> => requests.ask(async () => {
    try {
      const wanted = first ? { staged: staged(), weather: moment.weather, exposed } : asked();
      const answer = await api.live(session.name, "light", wanted);
      const found = factsOf<Lit>(answer);
      const json = await answer.text();
      if (first) begin(found.captured);
      if (widget) await widget.replace((JSON.parse(json) as { states: [State] }).states[0]);
      else await build(json);
      facts.classList.remove("bad");
      facts.textContent = `Sun ${found.sun_elevation_deg.toFixed(0)}° high · outdoors ${(found.global_horizontal_lx / 1000).toFixed(1)} klx · room ${found.median_luminance.toPrecision(3)} ${found.unit} ± ${(100 * found.uncertainty).toFixed(0)} % · ${(100 * found.sunny_share).toFixed(1)} % in the sun`;
      facts.dataset.lit = `${local()} ${moment.weather} ${moment.state}`;
      facts.dataset.seconds = String(found.seconds);
      for (const old of [glare, more, box.querySelector("[data-part=region]")!]) old.textContent = "";
    } catch (error) {
      facts.classList.add("bad");
      facts.textContent = (error as Error).message;
    }
  });

  /** Begin at the moment of the capture. */
  function begin(captured: string): void {
    const at = Date.parse(`${captured.replace(" ", "T")}Z`);
    year = new Date(at).getUTCFullYear();
    const days = (at - Date.UTC(year, 0, 1)) / DAY_MS;
    day.max = String((Date.UTC(year + 1, 0, 1) - Date.UTC(year, 0, 1)) / DAY_MS - 1);
    moment = kept = { ...moment, day: Math.floor(days), minute: Math.min(1430, 10 * Math.round(144 * (days % 1))) };
    controls();
  }

  async function build(json: string): Promise<void> {
    const regions = new Regions();
    const made = markup(json, regions.control);
    box.replaceChildren(made, regions.said);
    widget = await setUpPanorama(made, true);
    regions.on(widget);
    const glass = room.openings.filter((o) => o.kind === "window").sort((a, b) => b.end_m - b.start_m - (a.end_m - a.start_m))[0];
    if (glass) {
      const [x, y] = onWall(room, glass.wall, (glass.start_m + glass.end_m) / 2);
      widget.view.look(Math.atan2(x, y) / (Math.PI / 180), -8);
    }
  }

  const plan = new Plan(room.floor, "Plan: place the seat where someone sits; R rotates").showing(room);
  const reach = 9 * plan.scale;
  const seat = svg("g", { class: "seat", tabindex: 0, role: "button", "aria-label": "Seat: drag, or arrow keys; R rotates" },
    svg("path", { d: `M0 0L${-0.5 * reach} ${-reach}A${1.118 * reach} ${1.118 * reach} 0 0 1 ${0.5 * reach} ${-reach}Z` }), svg("circle", { r: 2.2 * plan.scale }));
  plan.element.append(svg("circle", { class: "camera", r: 1.3 * plan.scale }), seat);

  function drawSeat(): void {
    const [x, y] = moment.seat ?? [0, 0];
    seat.setAttribute("transform", `translate(${x} ${-y}) rotate(${moment.azimuth})`);
  }

  function sit(changed: Partial<Moment>, keep = true): void {
    if (keep) undo.step(kept);
    moment = { ...moment, ...changed };
    if (keep) kept = moment;
    drawSeat();
    glare.textContent = more.textContent = "";
  }

  draggable(seat, () => {
    const before = kept;
    return {
      move: (event) => sit({ seat: plan.at(event).map(round) as Point }, false),
      end: () => {
        if (moment.seat === before.seat) return;
        undo.step(before);
        kept = moment;
        void ask();
      },
    };
  });
  seat.addEventListener("keydown", (event) => {
    const arrow = ARROWS[event.key];
    const [x, y] = moment.seat ?? [0, 0];
    const by = event.shiftKey ? 0.5 : 0.1;
    if (arrow) sit({ seat: [round(x + arrow[0] * by), round(y + arrow[1] * by)] });
    else if (event.key === "r" || event.key === "R") turn(event.shiftKey ? -TURN_DEG : TURN_DEG);
    else if (event.key === "Enter") void ask();
    else return;
    event.preventDefault();
  });
  const turn = (by: number): void => sit({ azimuth: ((moment.azimuth + by + 540) % 360) - 180 });

  const ask = (): Promise<void> => seats.ask(async () => {
    const wanted = moment;
    glare.classList.remove("bad");
    glare.textContent = "Rendering from the seat …";
    more.textContent = "";
    try {
      const answer = await api.live(session.name, "glare", { ...asked(), seat_m: moment.seat, azimuth_deg: moment.azimuth });
      const { figures, rating, faint, seen_share, sun_in_view } = (await answer.json()) as Glare;
      if (moment !== wanted) return; // another seat or light by now
      const of = (name: string): string => quantityText(figures[name]!.value, figures[name]!.uncertainty);
      glare.textContent = `Glare ${rating}: DGP ${of("dgp")}`;
      glare.classList.toggle("bad", figures.dgp!.value >= 0.4);
      glare.dataset.dgp = String(figures.dgp!.value);
      more.textContent = [
        `at the eye ${of("ev_lx")} lx, ${figures.sources!.value ? `UGR ${of("ugr")}, DGI ${of("dgi")}` : "no glare source in view"}`,
        faint ? "too little light at the eye for the formula (under 380 lx)" : "",
        sun_in_view ? "the sun itself is visible through a window ahead: actual glare is worse" : "",
        moment.seat ? `${(100 * seen_share).toFixed(0)} % of the view was photographed, the rest is rendered; eyes 1.2 m high` : "from the camera position",
      ].filter(Boolean).join(" · ");
    } catch (error) {
      glare.classList.add("bad");
      glare.textContent = (error as Error).message;
    }
  });

  controls();
  void light(true);
  return {
    element: h("section", { class: "side-by-side" }, h("div", {}, bar, box, facts),
      h("div", {}, h("h2", {}, "Glare from a seat"), plan.element,
        h("div", { class: "bar" }, button("Look from here", () => void ask(), { class: "main" }), button("Rotate (R)", () => turn(TURN_DEG)), button("At the camera", () => sit({ seat: null })),
          button("Undo", () => undo.back(moment), { "data-part": "undo" }), button("Redo", () => undo.again(moment))), glare, more)),
    undo: () => undo.back(moment),
    redo: () => undo.again(moment),
    command,
    run: { text: "Keep this light", ask: () => ({ at: local(), weather: moment.weather, staged: staged() }) },
    close: () => widget?.view.dispose(),
  };
}
