// The browser's half of processing/report/states.py: numbers and light out of text and 8-bit pictures.

export type Size = readonly [width: number, height: number];

/** Luminance of code 1, cd/m2, and the natural logarithm from a code to the next. */
export const LEAST = 1e-6;
export const STEP = 0.001;
/** Exponent of a picture's code: v^n / (v^n + middle^n). */
export const SHAPE = 0.7;

export const fromBase64 = (text: string): Uint8Array<ArrayBuffer> => Uint8Array.from(atob(text), (c) => c.charCodeAt(0));

/** Unpack a map of codes: width * height whole numbers, of 1 or 2 bytes. */
export async function unpacked(text: string, [width, height]: Size, size: 1 | 2): Promise<Uint8Array | Uint16Array> {
  const stream = new Blob([fromBase64(text)]).stream().pipeThrough(new DecompressionStream("deflate"));
  const planes = new Uint8Array(await new Response(stream).arrayBuffer());
  const count = width * height;
  if (planes.length !== count * size) throw new Error("a map of another size");
  const codes = size === 2 ? new Uint16Array(count) : new Uint8Array(count);
  const most = size === 2 ? 65535 : 255;
  for (let i = 0; i < count; i += 1) {
    const folded = size === 2 ? planes[i]! * 256 + planes[count + i]! : planes[i]!;
    const difference = folded & 1 ? -((folded + 1) >> 1) : folded >> 1;
    codes[i] = ((i % width ? codes[i - 1]! : 0) + difference) & most;
  }
  return codes;
}

/** Luminance of a code, NaN where there is none. */
export const luminance = (code: number): number => (code === 0 ? NaN : LEAST * Math.exp((code - 1) * STEP));

/** Relative standard uncertainty of a code, NaN where nothing is known. */
export const uncertainty = (code: number): number => (code === 0 ? NaN : 1e-4 * 1e5 ** ((code - 1) / 254));

const thousands = (text: string): string => text.replace(/^\d+/, (whole) => whole.replace(/\B(?=(\d{3})+$)/g, "\u2009"));

/** A number with its standard uncertainty, both to two digits of that; four digits where it is not known. */
export function quantityText(value: number, margin: number): string {
  if (value !== 0 && (value < 1e-3 || value >= 1e7)) {
    const share = Number.isNaN(margin) ? "" : ` ± ${((100 * margin) / value).toPrecision(2)} %`;
    return value.toExponential(3).replace(/e\+?/, " × 10^") + share;
  }
  const known = margin > 0;
  const decimals = known ? 1 - Math.floor(Math.log10(margin)) : value ? 3 - Math.floor(Math.log10(value)) : 0;
  const round = (x: number): string => {
    if (decimals > 0) return thousands(x.toFixed(decimals));
    const step = 10 ** -decimals;
    return thousands(String(Math.round(x / step) * step));
  };
  return known ? `${round(value)} ± ${round(margin)}` : round(value);
}
