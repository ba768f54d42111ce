// A scene in three dimensions to turn around: glTF, as processing/exchange/gltf.py writes it.
import {
  Box3, Light, Mesh, NeutralToneMapping, type Object3D, PerspectiveCamera, Plane, PMREMGenerator, Scene, Sphere,
  Spherical, Vector3, WebGLRenderer,
} from "three";
import { OrbitControls } from "three/examples/jsm/controls/OrbitControls.js";
import { RoomEnvironment } from "three/examples/jsm/environments/RoomEnvironment.js";
import { GLTFLoader } from "three/examples/jsm/loaders/GLTFLoader.js";

const RAD = Math.PI / 180;
/** Where one looks from at first: above the walls, from a corner. */
const FIRST = { polar: 48 * RAD, azimuth: 35 * RAD, closeness: 0.85 };
const KEYS: Record<string, [number, number]> = {
  ArrowLeft: [-0.12, 0], ArrowRight: [0.12, 0], ArrowUp: [0, -0.08], ArrowDown: [0, 0.08],
};

/** A wall's plane, its normal into the room, and the reveals of its windows and doors. */
interface Wall {
  plane: Plane;
  reveals: Object3D[];
}

/** The walls of a room by the names that the file gives its parts. A reveal is of the wall that it is just behind. */
function wallsOf(scene: Scene): Wall[] {
  const walls: Wall[] = [];
  const reveals: Object3D[] = [];
  scene.updateMatrixWorld(true);
  scene.traverse((one) => {
    if (!(one instanceof Mesh)) return;
    if (one.name.startsWith("reveal-")) reveals.push(one);
    if (!/^wall-\d+$/.test(one.name)) return;
    const { normal, position } = one.geometry.attributes;
    const inwards = new Vector3().fromBufferAttribute(normal, 0).transformDirection(one.matrixWorld);
    const place = new Vector3().fromBufferAttribute(position, 0).applyMatrix4(one.matrixWorld);
    walls.push({ plane: new Plane().setFromNormalAndCoplanarPoint(inwards, place), reveals: [] });
  });
  for (const reveal of reveals) {
    const middle = new Box3().setFromObject(reveal).getCenter(new Vector3());
    const behind = (wall: Wall): number => {
      const away = -wall.plane.distanceToPoint(middle);
      return away < 0 ? Infinity : away;
    };
    walls.reduce((best, wall) => (behind(wall) < behind(best) ? wall : best), walls[0]!)?.reveals.push(reveal);
  }
  return walls;
}

export class ModelView {
  readonly renderer: WebGLRenderer;
  private readonly camera = new PerspectiveCamera(30, 1, 0.05, 200);
  private readonly controls: OrbitControls;
  private scene = new Scene();
  private walls: Wall[] = [];
  private waiting = false;

  constructor(readonly stage: HTMLElement) {
    this.renderer = new WebGLRenderer({ antialias: true, alpha: true });
    this.renderer.setPixelRatio(Math.min(2, window.devicePixelRatio));
    this.renderer.toneMapping = NeutralToneMapping;
    this.renderer.toneMappingExposure = 1.1;
    const canvas = this.renderer.domElement;
    canvas.setAttribute("role", "img");
    stage.prepend(canvas);
    stage.tabIndex = 0;
    this.controls = new OrbitControls(this.camera, canvas);
    this.controls.maxPolarAngle = 88 * RAD;
    this.controls.enableZoom = false; // the wheel scrolls the page; pinch, ctrl and the keyboard zoom
    this.controls.addEventListener("change", () => this.draw());
    canvas.style.touchAction = "pan-y";
    stage.addEventListener("wheel", (event) => {
      this.controls.enableZoom = event.ctrlKey || document.fullscreenElement === stage;
    }, { capture: true, passive: true });
    stage.addEventListener("keydown", (event) => this.key(event));
    new ResizeObserver(() => this.fit()).observe(stage);
  }

  /** Show a GLB in place of what was there. */
  async show(bytes: ArrayBuffer, alt: string): Promise<void> {
    const found = await new GLTFLoader().parseAsync(bytes, "");
    // The file's sun is in lux, for renderers; here all is lit evenly.
    found.scene.traverse((one) => { one.visible = !(one instanceof Light); });
    const scene = new Scene();
    scene.add(found.scene);
    const light = new PMREMGenerator(this.renderer);
    scene.environment = light.fromScene(new RoomEnvironment(), 0.04).texture;
    light.dispose();
    this.scene = scene;
    this.walls = wallsOf(scene);
    this.renderer.domElement.ariaLabel = alt;
    this.aim();
    this.fit();
  }

  private aim(): void {
    const around = new Box3().setFromObject(this.scene).getBoundingSphere(new Sphere());
    const away = (around.radius / Math.sin((this.camera.fov / 2) * RAD)) * FIRST.closeness;
    this.controls.target.copy(around.center);
    const from = new Vector3().setFromSpherical(new Spherical(away, FIRST.polar, FIRST.azimuth));
    this.camera.position.copy(around.center).add(from);
    this.controls.minDistance = 0.2 * away;
    this.controls.maxDistance = 2.5 * away;
    this.controls.update();
  }

  private fit(): void {
    const [width, height] = [Math.max(1, this.stage.clientWidth), Math.max(1, this.stage.clientHeight)];
    this.renderer.setSize(width, height);
    this.camera.aspect = width / height;
    this.camera.updateProjectionMatrix();
    this.draw();
  }

  private draw(): void {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      // A wall that is seen from behind is not drawn: its reveals would hang in the air.
      for (const { plane, reveals } of this.walls) {
        for (const one of reveals) one.visible = plane.distanceToPoint(this.camera.position) > 0;
      }
      this.renderer.render(this.scene, this.camera);
    });
  }

  private key(event: KeyboardEvent): void {
    const turn = KEYS[event.key];
    const nearer = event.key === "+" || event.key === "=" ? 1 / 1.1 : event.key === "-" ? 1.1 : 1;
    if (event.ctrlKey || event.metaKey || event.altKey || (!turn && nearer === 1)) return;
    event.preventDefault();
    const place = new Spherical().setFromVector3(this.camera.position.clone().sub(this.controls.target));
    place.theta += turn?.[0] ?? 0;
    place.phi = Math.max(0.02, Math.min(this.controls.maxPolarAngle, place.phi + (turn?.[1] ?? 0)));
    place.radius = Math.max(this.controls.minDistance, Math.min(this.controls.maxDistance, place.radius * nearer));
    this.camera.position.setFromSpherical(place).add(this.controls.target);
    this.controls.update();
    this.draw();
  }
}
