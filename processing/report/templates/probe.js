"use strict";
// Reads a state's numbers at a direction: one pixel of the picture on disk, and what it is worth.
(function () {
  const worth = ["", "clipped: at least this", "too dark to tell well", "outside the lens's field", "repaired: a model's value"];

  /** Load a state's maps; `at(longitude, latitude)` in degrees then tells a pixel. */
  daylit.openProbe = async function (state) {
    const [luminance, uncertainty, validity] = await Promise.all([
      daylit.unpacked(state.luminance, state.map_px, 2),
      daylit.unpacked(state.uncertainty, state.map_px, 1),
      daylit.unpacked(state.validity, state.map_px, 1),
    ]);
    const [width, height] = state.map_px;
    const [wide, high] = state.picture_px;
    return {
      luminance,
      at(longitude, latitude) {
        const turns = (longitude / 360 + 0.5) % 1;
        const column = Math.min(width - 1, Math.floor((turns < 0 ? turns + 1 : turns) * width));
        const row = Math.max(0, Math.min(height - 1, Math.floor((0.5 - latitude / 180) * height)));
        const index = row * width + column;
        return {
          luminance: daylit.luminance(luminance[index]),
          relativeUncertainty: daylit.uncertainty(uncertainty[index]),
          worth: worth[validity[index]] || "",
          x: Math.floor(((column + 0.5) * wide) / width),
          y: Math.floor(((row + 0.5) * high) / height),
        };
      },
    };
  };

  /** A reading in words: value, uncertainty and unit; then where, and what it is worth. */
  daylit.readingText = function (reading, longitude, latitude, unit) {
    const where =
      `${Math.abs(longitude).toFixed(1)}° ${longitude < 0 ? "left" : "right"}, ` +
      `${Math.abs(latitude).toFixed(1)}° ${latitude < 0 ? "down" : "up"} · pixel ${reading.x}, ${reading.y}`;
    if (Number.isNaN(reading.luminance)) return { value: "no value", detail: [reading.worth, where].filter(Boolean).join(" · ") };
    const share = reading.relativeUncertainty;
    const percent = Number.isNaN(share) ? "uncertainty unknown" : `± ${(100 * share).toPrecision(2)} %`;
    return {
      value: `${daylit.quantityText(reading.luminance, share * reading.luminance)} ${unit}`,
      detail: [percent, reading.worth, where].filter(Boolean).join(" · "),
    };
  };
})();
