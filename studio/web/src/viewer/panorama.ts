// A panorama to look around in: one triangle, whose shader turns, exposes and colours.
import {
  BufferGeometry, Camera, DataTexture, Float32BufferAttribute, GLSL3, LinearFilter, Mesh, NearestFilter, RawShaderMaterial,
  RepeatWrapping, RGBAFormat, Scene, Texture, Vector2, WebGLRenderer,
} from "three";
import { SHAPE } from "./encoding";

const VERTEX = `
in vec3 position;
out vec2 place;
void main() { place = position.xy; gl_Position = vec4(position.xy, 0.0, 1.0); }`;

// The tone curve is `film` of processing/pictures/display.py: a toe, in proportion up to KNEE, then rolled off.
const FRAGMENT = `
precision highp float;
const float TOE = 0.3, TOE_END = 0.15, KNEE = 0.55;
uniform sampler2D map;
uniform vec2 turn, spread;
uniform float gain;
uniform bool codes;
in vec2 place;
out vec4 shown;

vec3 light(vec3 code) {
  vec3 bytes = code * 255.0;
  return gain * pow(bytes / max(255.0 - bytes, 0.25), vec3(1.0 / ${SHAPE}));
}

vec3 screen(vec3 linear) {
  vec3 x = clamp(linear, 0.0, 1.0);
  return mix(12.92 * x, 1.055 * pow(x, vec3(1.0 / 2.4)) - 0.055, step(0.0031308, x));
}

void main() {
  vec2 s = sin(turn), c = cos(turn);
  vec3 ahead = vec3(s.x * c.y, c.x * c.y, s.y), right = vec3(c.x, -s.x, 0.0), up = vec3(-s.x * s.y, -c.x * s.y, c.y);
  vec3 ray = normalize(ahead + place.x * spread.x * right + place.y * spread.y * up);
  vec2 at = vec2(atan(ray.x, ray.y) / 6.283185307 + 0.5, 0.5 - asin(clamp(ray.z, -1.0, 1.0)) / 3.141592654);
  vec3 found = textureLod(map, at, 0.0).rgb;
  if (codes) {
    vec3 lit = light(found);
    vec3 deep = min(lit / TOE_END, 1e6);
    lit *= 1.0 - TOE / (1.0 + deep * deep);
    vec3 over = max(lit - KNEE, 0.0) / (1.0 - KNEE);
    found = screen(min(lit, KNEE) + (1.0 - KNEE) * over / (1.0 + over));
  }
  shown = vec4(found, 1.0);
}`;

export const RAD = Math.PI / 180;
const FIELD = { least: 25, most: 140 };
const STEP_DEG = 4;

export interface Look {
  /** Horizontal field of view, degrees. */
  field?: number;
  yaw?: number;
  /** Whether the wheel zooms when the view does not fill the screen: else it scrolls the page. */
  wheel?: boolean;
}

/** Show a picture in `stage`; `changed` is called when the view has turned. Angles are degrees. */
export class PanoramaView {
  yaw: number;
  pitch = 0;
  field: number;
  /** The view stands still while something else is dragged on it. */
  held = false;
  changed: () => void = () => undefined;
  readonly canvas: HTMLCanvasElement;
  readonly material: RawShaderMaterial;
  private readonly renderer: WebGLRenderer;
  private readonly scene = new Scene();
  private readonly camera = new Camera();
  private readonly pointers = new Map<number, [number, number]>();
  private waiting = false;

  constructor(readonly stage: HTMLElement, look: Look = {}) {
    this.yaw = look.yaw ?? 0;
    this.field = look.field ?? 95;
    this.renderer = new WebGLRenderer({ antialias: false, powerPreference: "low-power" });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.canvas = this.renderer.domElement;
    this.material = new RawShaderMaterial({
      glslVersion: GLSL3, vertexShader: VERTEX, fragmentShader: FRAGMENT, depthTest: false,
      uniforms: {
        map: { value: new Texture() }, turn: { value: new Vector2() }, spread: { value: new Vector2() },
        gain: { value: 1 }, codes: { value: false },
      },
    });
    const triangle = new BufferGeometry().setAttribute("position", new Float32BufferAttribute([-1, -1, 0, 3, -1, 0, -1, 3, 0], 3));
    const mesh = new Mesh(triangle, this.material);
    mesh.frustumCulled = false;
    this.scene.add(mesh);
    stage.prepend(this.canvas, this.buttons());
    stage.tabIndex = 0;
    new ResizeObserver(() => this.fit()).observe(stage);
    this.canvas.addEventListener("webglcontextrestored", () => this.draw());
    this.listen(look.wheel ?? false);
    this.fit();
  }

  /** Show a picture or a canvas; `codes`: its bytes are codes of light, exposed by `expose`. */
  picture(source: TexImageSource, codes: boolean): void {
    const texture = new Texture(source as HTMLImageElement);
    texture.minFilter = LinearFilter;
    this.use(texture, codes);
  }

  /** Show colours as they are, (4 bytes a place), each place by itself. */
  colours(bytes: Uint8ClampedArray<ArrayBuffer>, width: number, height: number): void {
    const texture = new DataTexture(new Uint8Array(bytes.buffer), width, height, RGBAFormat);
    texture.magFilter = texture.minFilter = NearestFilter;
    this.use(texture, false);
  }

  /** Light of the middle code on the tone curve's scale. */
  expose(middle: number): void {
    this.material.uniforms.gain!.value = middle;
    this.draw();
  }

  /** Give the graphics memory back: browsers keep some sixteen views alive. */
  dispose(): void {
    this.material.uniforms.map!.value.dispose();
    this.renderer.dispose();
    this.renderer.forceContextLoss();
  }

  look(yaw: number, pitch: number, field = this.field): void {
    this.yaw = ((((yaw + 180) % 360) + 360) % 360) - 180;
    this.pitch = Math.max(-90, Math.min(90, pitch));
    this.field = Math.max(FIELD.least, Math.min(FIELD.most, field));
    this.draw();
    this.changed();
  }

  /** Longitude and latitude at a place of the page. */
  directionAt(event: { clientX: number; clientY: number }): [number, number] {
    const box = this.canvas.getBoundingClientRect();
    const [wide, high] = this.spread();
    const right = (((event.clientX - box.left) / box.width) * 2 - 1) * wide;
    const up = (1 - ((event.clientY - box.top) / box.height) * 2) * high;
    const [sinPitch, cosPitch] = [Math.sin(this.pitch * RAD), Math.cos(this.pitch * RAD)];
    const ahead = cosPitch - up * sinPitch;
    const longitude = this.yaw + Math.atan2(right, ahead) / RAD;
    const latitude = Math.atan2(sinPitch + up * cosPitch, Math.hypot(right, ahead)) / RAD;
    return [((((longitude + 180) % 360) + 360) % 360) - 180, latitude];
  }

  /** Where a ray (x right, y ahead, z up) meets the stage, in its pixels; null behind the viewer. */
  placeOf([x, y, z]: readonly [number, number, number]): [number, number] | null {
    const [s, c] = [Math.sin(this.yaw * RAD), Math.cos(this.yaw * RAD)];
    const [sp, cp] = [Math.sin(this.pitch * RAD), Math.cos(this.pitch * RAD)];
    const level = s * x + c * y;
    const depth = level * cp + z * sp;
    if (depth <= 1e-3 * Math.hypot(x, y, z)) return null;
    const [wide, high] = this.spread();
    const across = (c * x - s * y) / depth / wide;
    const upward = (z * cp - level * sp) / depth / high;
    return [((across + 1) / 2) * this.stage.clientWidth, ((1 - upward) / 2) * this.stage.clientHeight];
  }

  draw(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      const [wide, high] = this.spread();
      this.material.uniforms.turn!.value.set(this.yaw * RAD, this.pitch * RAD);
      this.material.uniforms.spread!.value.set(wide, high);
      this.renderer.render(this.scene, this.camera);
    });
  }

  private spread(): [number, number] {
    const wide = Math.tan((this.field / 2) * RAD);
    return [wide, (wide * Math.max(1, this.stage.clientHeight)) / Math.max(1, this.stage.clientWidth)];
  }

  private use(texture: Texture, codes: boolean): void {
    texture.wrapS = RepeatWrapping;
    texture.flipY = false;
    texture.generateMipmaps = false;
    texture.needsUpdate = true;
    this.material.uniforms.map!.value.dispose();
    this.material.uniforms.map!.value = texture;
    this.material.uniforms.codes!.value = codes;
    this.draw();
  }

  private fit(): void {
    this.renderer.setSize(this.stage.clientWidth, this.stage.clientHeight);
    this.draw();
    this.changed();
  }

  private buttons(): HTMLElement {
    const box = document.createElement("div");
    box.className = "steer";
    const whole = (): void => void (document.fullscreenElement ? document.exitFullscreen() : this.stage.requestFullscreen());
    const all: [string, string, () => void][] = [
      ["+", "Zoom in", () => this.look(this.yaw, this.pitch, this.field / 1.2)],
      ["−", "Zoom out", () => this.look(this.yaw, this.pitch, this.field * 1.2)],
      ["", "Full screen", whole],
    ];
    for (const [text, label, act] of all) {
      if (act === whole && !document.fullscreenEnabled) continue;
      const button = document.createElement("button");
      Object.assign(button, { type: "button", textContent: text, ariaLabel: label, title: label });
      if (!text) button.innerHTML = '<svg width="14" height="14" viewBox="0 0 14 14" aria-hidden="true"><path d="M1 5V1h4M9 1h4v4M13 9v4H9M5 13H1V9" fill="none" stroke="#fff" stroke-width="1.6"/></svg>';
      button.addEventListener("click", act);
      box.append(button);
    }
    return box;
  }

  private listen(wheel: boolean): void {
    const { canvas, stage } = this;
    canvas.style.touchAction = wheel ? "none" : "pan-y";
    canvas.addEventListener("pointerdown", (event) => {
      if (this.held) return;
      this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
      canvas.setPointerCapture(event.pointerId);
    });
    canvas.addEventListener("pointermove", (event) => this.drag(event));
    for (const end of ["pointerup", "pointercancel"] as const)
      canvas.addEventListener(end, (event) => this.pointers.delete(event.pointerId));
    stage.addEventListener("wheel", (event) => {
      if (!wheel && !event.ctrlKey && document.fullscreenElement !== stage) return;
      event.preventDefault();
      this.look(this.yaw, this.pitch, this.field * 1.0015 ** event.deltaY);
    }, { passive: false });
    stage.addEventListener("keydown", (event) => this.key(event));
  }

  private drag(event: PointerEvent): void {
    const before = this.pointers.get(event.pointerId);
    if (!before || this.held) return;
    const others = [...this.pointers].filter(([id]) => id !== event.pointerId).map(([, place]) => place);
    this.pointers.set(event.pointerId, [event.clientX, event.clientY]);
    if (others[0]) {
      const apart = (place: [number, number]): number => Math.hypot(place[0] - others[0]![0], place[1] - others[0]![1]);
      const ratio = apart(before) / Math.max(1, apart([event.clientX, event.clientY]));
      this.look(this.yaw, this.pitch, this.field * ratio);
      return;
    }
    const perPixel = this.field / this.stage.clientWidth;
    this.look(this.yaw - (event.clientX - before[0]) * perPixel, this.pitch + (event.clientY - before[1]) * perPixel);
  }

  private key(event: KeyboardEvent): void {
    if (event.target !== this.stage || event.ctrlKey || event.metaKey || event.altKey) return;
    const step = (STEP_DEG * this.field) / 95;
    const moves: Record<string, [number, number, number]> = {
      ArrowLeft: [-step, 0, 1], ArrowRight: [step, 0, 1], ArrowUp: [0, step, 1], ArrowDown: [0, -step, 1],
      "+": [0, 0, 1 / 1.1], "=": [0, 0, 1 / 1.1], "-": [0, 0, 1.1],
    };
    const move = moves[event.key];
    if (!move) return;
    event.preventDefault();
    this.look(this.yaw + move[0], this.pitch + move[1], this.field * move[2]);
  }
}
