// The rig's instruments with battery, card and clock, looked at again and again while nobody captures with them.
import { api, type Check } from "./api";
import { button, h } from "./dom";

/** After the page has come, and from one look to the next. */
const [FIRST_MS, AGAIN_MS] = [500, 30_000];
/** Of all that doctor looks at: what one takes along; without a rig file, what is connected. */
const RIG = /^(indoor|outdoor|meter)\b/;
const LINKS = /^(cameras?|serial port|disk)\b/;
const MARKS: Record<Check["level"], string> = { ok: "ready", warn: "check", fail: "not ready" };

/** A list that stands for itself; `again(world)` looks at once at this computer's rig (""), or at simulated ones. */
export function instruments(): { element: HTMLElement; again: (world: string) => void } {
  const list = h("ul", { class: "instruments", "data-part": "instruments" });
  const words = h("p", { class: "facts", role: "status" }, "Checking the instruments …");
  const element = h("div", {}, words, list, button("Check again", () => void look()));
  let world = "";
  let timer = 0;
  const line = ({ level, name, text, advice, code }: Check): HTMLElement =>
    h("li", { class: level }, h("span", { class: "mark" }, MARKS[level]), h("strong", {}, name), h("span", {}, code ? `${text} (${code})` : text), advice && level !== "ok" ? h("span", { class: "facts" }, advice) : null);

  async function look(): Promise<void> {
    clearTimeout(timer);
    const asked = world;
    try {
      const { checks = [], error, capturing } = await api.instruments(asked);
      if (asked !== world) return;
      const rig = checks.filter((one) => RIG.test(one.name));
      const shown = [...(rig.length ? rig : checks.filter((one) => LINKS.test(one.name))), ...(rig.length ? checks.filter((one) => one.name === "disk").slice(-1) : [])];
      if (error) shown.unshift({ level: "fail", name: "rig", text: error.message, advice: error.advice ?? "", code: error.code });
      list.replaceChildren(...shown.map(line));
      words.textContent = capturing ? "A capture is using them: this was their state before it" : `Checked at ${new Date().toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" })}, as daylit doctor does`;
      list.dataset.seen = asked;
    } catch (problem) {
      words.textContent = (problem as Error).message;
    }
    timer = window.setTimeout(() => element.isConnected && void look(), AGAIN_MS);
  }
  return {
    element,
    again: (now) => {
      world = now;
      words.textContent = "Checking the instruments …";
      clearTimeout(timer);
      timer = window.setTimeout(() => element.isConnected && void look(), FIRST_MS);
    },
  };
}
