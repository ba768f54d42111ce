// What the server knows and takes (studio/server.py).
export type Point = [number, number];
export type Pose = [x: number, y: number, theta: number, design: string];

export interface Opening {
  kind: "window" | "door" | "passage";
  wall: number;
  start_m: number;
  end_m: number;
  sill_m: number;
  head_m: number;
  confidence: number;
}

export interface Room {
  schema_version: 1;
  source: string;
  floor: Point[];
  camera_height_m: number;
  ceiling_height_m: number;
  openings: Opening[];
  confidence: number;
  note: string;
  /** What a new estimate keeps: "ceiling", "wall 2"; none: all in which it differs from the first estimate. */
  held?: string[];
}

export interface Piece {
  id: string;
  category: string;
  model: string;
  size_m: [number, number, number];
  theta_rad: number;
  t_m: [number, number, number];
  /** The piece that it stands with, or on. */
  group: string;
}

export interface Job {
  command: string;
  lines: string[];
  running: boolean;
  code: number | null;
}

export interface Card {
  name: string;
  title: string;
  taken: string;
  status: string;
  missing: string[];
  simulated?: boolean;
  frames?: number;
  stages?: string[];
}

export interface Overview extends Card {
  path: string;
  states: string[];
  /** Whether direct sun was detected. */
  sunlight: boolean;
  chosen: Record<string, string | number>;
  page: boolean;
  stamp: string;
  job: Job | null;
}

export interface Check {
  level: "ok" | "warn" | "fail";
  name: string;
  text: string;
  advice: string;
  /** Of the error that it is. */
  code?: string;
}

/** What doctor found, or why it could not. */
export interface Instruments {
  checks?: Check[];
  error?: { code: string; message: string; advice?: string };
  capturing: boolean;
}

export interface Frame {
  file: string;
  side: string;
  stop: number;
  statistics?: { clipped_frac: number };
}

export interface Capture {
  status: string;
  missing: string[];
  bracket: { mode: string; stops_s: number[]; sides: string[] };
  devices: { role: string; model: string; simulated: boolean; clock_offset_s?: number; lens?: string; nd_filter?: string }[];
  frames: Frame[];
  readings: { luminance_cd_m2?: number; when: string; status: string }[];
  drift_frac?: number;
  warnings: { code: string; message: string }[];
}

/** What the server refused, in words for people. */
export class Refused extends Error {
  constructor(message: string, readonly status: number) {
    super(message);
  }
}

async function ask(path: string, options: RequestInit = {}): Promise<Response> {
  let answer: Response;
  try {
    answer = await fetch(path, options);
  } catch {
    throw new Refused("The server does not answer: start daylit studio again. Saved work is not lost.", 0);
  }
  if (answer.ok) return answer;
  const text = await answer.text();
  let message = text;
  try {
    const { error } = JSON.parse(text) as { error: { message: string; advice?: string } };
    message = [error.message, error.advice].filter(Boolean).join(": ");
  } catch {
    // Plain text then.
  }
  throw new Refused(message, answer.status);
}

const at = (session: string, rest = ""): string => `/api/sessions/${encodeURIComponent(session)}${rest}`;

/** What a preview says of itself beside its bytes. */
export const factsOf = <T>(answer: Response): T => JSON.parse(answer.headers.get("x-facts") ?? "{}") as T;

/** A correction as it is now, and what names that state. */
export interface Corrected<T> {
  value: T;
  digest: string;
  corrected: boolean;
}

async function corrected<T>(answer: Response, read: (answer: Response) => Promise<T>): Promise<Corrected<T>> {
  const { headers } = answer;
  return { value: await read(answer), digest: headers.get("x-digest") ?? "", corrected: headers.get("x-corrected") === "1" };
}

export const api = {
  instruments: async (world: string): Promise<Instruments> => (await ask(`/api/instruments?simulate=${encodeURIComponent(world)}`)).json(),
  capturing: async (asked: { room: string; simulate: string | null }): Promise<void> =>
    void (await ask("/api/capture", { method: "POST", body: JSON.stringify(asked) })),
  /** Take a file into the folder; its session's name. */
  bring: async (name: string, file: Blob): Promise<string> =>
    ((await (await ask(`/api/import?name=${encodeURIComponent(name)}`, { method: "POST", body: file })).json()) as { name: string }).name,
  sessions: async (): Promise<{ folder: string; sessions: Card[]; job: Job | null }> => (await ask("/api/sessions")).json(),
  overview: async (session: string): Promise<Overview> => (await ask(at(session))).json(),
  capture: async (session: string): Promise<Capture> => (await ask(at(session, "/capture"))).json(),
  viewer: async (session: string, state: string): Promise<string> => (await ask(at(session, `/viewer?state=${encodeURIComponent(state)}`))).text(),
  picture: (session: string, state: string, width: number, stamp: string): string =>
    at(session, `/picture?state=${encodeURIComponent(state)}&width=${width}&at=${stamp}`),
  frame: (session: string, file: string): string => at(session, `/frame?file=${encodeURIComponent(file)}`),
  file: (session: string, path: string): string => at(session, `/files/${path}`),
  read: async <T>(session: string, what: string, read: (answer: Response) => Promise<T>): Promise<Corrected<T>> =>
    corrected(await ask(at(session, `/correction/${what}`)), read),
  write: async <T>(session: string, what: string, base: string, body: BodyInit, read: (answer: Response) => Promise<T>): Promise<Corrected<T>> =>
    corrected(await ask(at(session, `/correction/${what}?base=${base}`), { method: "PUT", body }), read),
  forget: async (session: string, what: string): Promise<void> => void (await ask(at(session, `/correction/${what}`), { method: "DELETE" })),
  judge: async (session: string, places: Record<string, Pose>): Promise<string[]> =>
    ((await (await ask(at(session, "/judge"), { method: "POST", body: JSON.stringify(places) })).json()) as { broken: string[] }).broken,
  /** By category the designs that a piece may have. */
  designs: async (session: string): Promise<Record<string, Record<string, unknown>>> => (await ask(at(session, "/designs"))).json(),
  run: async (session: string, what: object): Promise<void> => void (await ask(at(session, "/run"), { method: "POST", body: JSON.stringify(what) })),
  live: async (session: string, what: string, asked: object): Promise<Response> => ask(at(session, `/live/${what}`), { method: "POST", body: JSON.stringify(asked) }),
  stop: async (session: string): Promise<void> => void (await ask(at(session, "/run"), { method: "DELETE" })),
  events: (session: string): EventSource => new EventSource(at(session, "/events")),
};
