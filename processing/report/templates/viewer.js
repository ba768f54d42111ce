"use strict";
// The 360-degree viewer: Pannellum turns, this file exposes, colours and reads.
(function () {
  const SMALL = "(max-width: 700px)";

  async function pixelsOf(url) {
    const image = new Image();
    image.src = url;
    await image.decode();
    const width = window.matchMedia(SMALL).matches ? Math.min(2048, image.width) : image.width;
    const canvas = document.createElement("canvas");
    canvas.width = width;
    canvas.height = width / 2;
    const context = canvas.getContext("2d", { willReadFrequently: true });
    context.drawImage(image, 0, 0, canvas.width, canvas.height);
    return context.getImageData(0, 0, canvas.width, canvas.height);
  }

  function exposed(codes, light, white) {
    const picture = new ImageData(codes.width, codes.height);
    const from = codes.data;
    const to = picture.data;
    const perWhite = 1 / (white * white);
    for (let i = 0; i < from.length; i += 4) {
      const [r, g, b] = [light[from[i]], light[from[i + 1]], light[from[i + 2]]];
      const luminance = 0.2127 * r + 0.7151 * g + 0.0722 * b;
      const scale = (4095 * (1 + luminance * perWhite)) / (1 + luminance);
      to[i] = daylit.screen[Math.min(4095, (r * scale) | 0)];
      to[i + 1] = daylit.screen[Math.min(4095, (g * scale) | 0)];
      to[i + 2] = daylit.screen[Math.min(4095, (b * scale) | 0)];
      to[i + 3] = 255;
    }
    return picture;
  }

  function falseColours(codes, [width, height], data, colours) {
    const shown = new ImageData(width, height);
    const [low, high] = data.range;
    const perStep = 256 / Math.log(high / low);
    const first = Math.log(low / 1e-6);
    for (let i = 0; i < codes.length; i += 1) {
      const level = Math.max(0, Math.min(255, Math.floor(((codes[i] - 1) * 0.001 - first) * perStep)));
      for (let c = 0; c < 3; c += 1) shown.data[4 * i + c] = codes[i] === 0 ? 64 : colours[3 * level + c];
      shown.data[4 * i + 3] = 255;
    }
    return shown;
  }

  function setUp(box) {
    const data = JSON.parse(box.querySelector(".viewer-data").textContent);
    const colours = daylit.fromBase64(data.colours);
    const find = (name) => box.querySelector(`[data-part=${name}]`);
    const stage = find("stage");
    const loaded = new Map();
    let current = 0;
    let stops = 0;
    let coloured = false;
    let pannellumViewer = null;
    let pointed = null;

    function load(index) {
      if (!loaded.has(index)) {
        const state = data.states[index];
        const url = URL.createObjectURL(new Blob([daylit.fromBase64(state.jpeg)], { type: "image/jpeg" }));
        // One state's pixels are kept, so that a phone's memory holds them.
        loaded.clear();
        loaded.set(index, Promise.all([pixelsOf(url), daylit.openProbe(state), url]));
      }
      return loaded.get(index);
    }

    async function draw() {
      const asked = current;
      const [codes, probe] = await load(asked);
      if (asked !== current || !pannellumViewer) return;
      const shown = coloured
        ? falseColours(probe.luminance, data.states[asked].map_px, data, colours)
        : exposed(codes, daylit.light(stops, data.middle), data.white);
      // Pannellum keeps its texture bound: new pixels go right into it, without loading the scene anew.
      const gl = pannellumViewer.getRenderer().getCanvas().getContext("experimental-webgl");
      gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGB, gl.RGB, gl.UNSIGNED_BYTE, shown);
      pannellumViewer.setUpdate(false);
      box.dataset.shown = `${asked} ${coloured ? "colours" : stops}`;
      read();
    }

    async function read() {
      const [, probe] = await load(current);
      if (!pannellumViewer) return;
      const [latitude, longitude] = pointed || [pannellumViewer.getPitch(), pannellumViewer.getYaw()];
      const reading = probe.at(longitude, latitude);
      const text = daylit.readingText(reading, longitude, latitude, data.unit);
      // Unrounded, for those who read the page by program.
      Object.assign(find("reading").dataset, { luminance: reading.luminance, x: reading.x, y: reading.y });
      find("reading").setAttribute("aria-live", pointed ? "off" : "polite");
      find("value").textContent = text.value;
      find("detail").textContent = `${pointed ? "under the pointer" : "at the cross"} · ${text.detail}`;
      stage.classList.toggle("pointed", pointed !== null);
    }

    function listen() {
      stage.addEventListener("pointermove", (event) => {
        pointed = event.pointerType === "mouse" ? pannellumViewer.mouseEventToCoords(event) : null;
        read();
      });
      stage.addEventListener("pointerleave", () => {
        pointed = null;
        read();
      });
      for (const name of ["animatefinished", "mouseup", "touchend", "zoomchange"]) pannellumViewer.on(name, read);
      find("exposure").addEventListener("input", (event) => {
        stops = Number(event.target.value);
        find("stops").textContent = `${stops > 0 ? "+" : ""}${stops.toFixed(1)} stops`;
        requestAnimationFrame(draw);
      });
      for (const choice of box.querySelectorAll("[data-mode]"))
        choice.addEventListener("change", () => {
          coloured = choice.dataset.mode === "colours";
          box.classList.toggle("coloured", coloured);
          draw();
        });
      find("state").addEventListener("change", (event) => {
        current = Number(event.target.value);
        find("label").hidden = !(data.label && data.states[current].staged);
        draw();
      });
    }

    async function open() {
      const [, , url] = await load(current);
      pannellumViewer = pannellum.viewer(stage, {
        type: "equirectangular", panorama: url, autoLoad: true, ignoreGPanoXMP: true, yaw: data.yaw_deg, hfov: 95,
        minHfov: 30, mouseZoom: "fullscreenonly", showFullscreenCtrl: true, strings: { loadingLabel: "" },
      });
      pannellumViewer.on("load", () => {
        listen();
        draw().then(() => box.classList.add("ready"));
      });
      daylit.viewer = pannellumViewer;
    }

    open().catch((error) => {
      find("value").textContent = "The viewer needs WebGL and a browser of 2023 or later.";
      find("detail").textContent = String(error);
    });
  }

  document.querySelectorAll(".viewer").forEach(setUp);
})();
