"use strict";
// The page's half of processing/report/encoding.py: numbers and light out of text and 8-bit pictures.
const daylit = (window.daylit = window.daylit || {});

daylit.fromBase64 = (text) => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

/** Unpack a map of codes: width * height whole numbers, of 1 or 2 bytes. */
daylit.unpacked = async function (text, [width, height], size) {
  const stream = new Blob([daylit.fromBase64(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height;
  if (planes.length !== count * size) throw new Error("a map of another size");
  const codes = size === 2 ? new Uint16Array(count) : new Uint8Array(count);
  const most = size === 2 ? 65535 : 255;
  for (let i = 0; i < count; i += 1) {
    const folded = size === 2 ? planes[i] * 256 + planes[count + i] : planes[i];
    const difference = folded & 1 ? -((folded + 1) >> 1) : folded >> 1;
    codes[i] = ((i % width ? codes[i - 1] : 0) + difference) & most;
  }
  return codes;
};

/** Luminance of a code, NaN where there is none. */
daylit.luminance = (code) => (code === 0 ? NaN : 1e-6 * Math.exp((code - 1) * 0.001));

/** Relative standard uncertainty of a code, NaN where nothing is known. */
daylit.uncertainty = (code) => (code === 0 ? NaN : 1e-4 * Math.pow(1e5, (code - 1) / 254));

/** Light of each of a picture's 256 codes, on the tone curve's scale, at a change of exposure in stops. */
daylit.light = function (stops, middle) {
  const table = new Float32Array(256);
  for (let code = 0; code < 256; code += 1)
    table[code] = middle * Math.pow(2, stops) * Math.pow(code / Math.max(255 - code, 0.25), 1 / 0.7);
  return table;
};

/** What the screen is told of linear light from 0 to 1 (sRGB), in 4096 steps. */
daylit.screen = Uint8ClampedArray.from({ length: 4096 }, (_, i) => {
  const linear = i / 4095;
  return 255 * (linear <= 0.0031308 ? 12.92 * linear : 1.055 * Math.pow(linear, 1 / 2.4) - 0.055);
});

const thousands = (text) => text.replace(/^\d+/, (whole) => whole.replace(/\B(?=(\d{3})+$)/g, "\u2009"));

/** A number with its standard uncertainty, both to two digits of that; four digits where it is not known. */
daylit.quantityText = function (value, uncertainty) {
  if (value !== 0 && (value < 1e-3 || value >= 1e7)) {
    const margin = Number.isNaN(uncertainty) ? "" : ` ± ${((100 * uncertainty) / value).toPrecision(2)} %`;
    return value.toExponential(3).replace(/e\+?/, " × 10^") + margin;
  }
  const known = uncertainty > 0;
  const decimals = known ? 1 - Math.floor(Math.log10(uncertainty)) : value ? 3 - Math.floor(Math.log10(value)) : 0;
  const round = (x) => {
    if (decimals > 0) return thousands(x.toFixed(decimals));
    const step = Math.pow(10, -decimals);
    return thousands(String(Math.round(x / step) * step));
  };
  return known ? `${round(value)} ± ${round(uncertainty)}` : round(value);
};
