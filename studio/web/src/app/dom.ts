// Elements in one line each, and words on the way.
type Child = Node | string | null | undefined | false;
type Attributes = Record<string, string | number | boolean | null | undefined | ((event: never) => void)>;

const SVG = "http://www.w3.org/2000/svg";

function filled<T extends Element>(element: T, attributes: Attributes, children: Child[]): T {
  for (const [name, value] of Object.entries(attributes)) {
    if (typeof value === "function") element.addEventListener(name, value as unknown as EventListener);
    else if (value === true) element.setAttribute(name, "");
    else if (value !== false && value !== null && value !== undefined) element.setAttribute(name, String(value));
  }
  for (const child of children) if (child) element.append(child);
  return element;
}

export function h<K extends keyof HTMLElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): HTMLElementTagNameMap[K] {
  return filled(document.createElement(tag), attributes, children);
}

export function svg<K extends keyof SVGElementTagNameMap>(tag: K, attributes: Attributes = {}, ...children: Child[]): SVGElementTagNameMap[K] {
  return filled(document.createElementNS(SVG, tag), attributes, children);
}

export const button = (text: string, click: () => void, more: Attributes = {}): HTMLButtonElement =>
  h("button", { type: "button", click, ...more }, text);

/** Show a sentence for a while; screen readers say it. */
export function note(text: string, bad = false): void {
  const box = document.getElementById("notes")!;
  const line = h("p", { class: bad ? "bad" : "" }, text);
  box.replaceChildren(line);
  setTimeout(() => line.remove(), bad ? 12000 : 4000);
}
