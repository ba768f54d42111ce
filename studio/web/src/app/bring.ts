// What is dropped or chosen to be imported: a panorama or a zip as it is, a folder as a zip that is made here.
import { api } from "./api";
import { button, h, note } from "./dom";

const MOST_BYTES = 4 * 2 ** 30;
const PICTURES = [".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".avif", ".heic", ".exr", ".hdr"];
const WORDS = "Drop a panorama, a session folder or a session zip here. For brackets: a folder containing indoor and outdoor.";

interface Found {
  path: string;
  file: File;
}

/** All files of what was dropped, with their paths. */
async function within(entry: FileSystemEntry): Promise<Found[]> {
  if (entry.isFile) {
    const file = await new Promise<File>((done, failed) => (entry as FileSystemFileEntry).file(done, failed));
    return [{ path: entry.fullPath.slice(1), file }];
  }
  const reader = (entry as FileSystemDirectoryEntry).createReader();
  const found: Found[] = [];
  for (;;) {
    const some = await new Promise<FileSystemEntry[]>((done, failed) => reader.readEntries(done, failed)); // a hundred at a time
    if (!some.length) return found;
    for (const one of some) found.push(...(await within(one)));
  }
}

const TABLE = Uint32Array.from({ length: 256 }, (_, n) => {
  let c = n;
  for (let k = 0; k < 8; k += 1) c = c & 1 ? 0xedb88320 ^ (c >>> 1) : c >>> 1;
  return c;
});

async function checksum(file: File): Promise<number> {
  let c = 0xffffffff;
  const reader = file.stream().getReader();
  for (;;) {
    const { done, value } = await reader.read();
    if (done) return (c ^ 0xffffffff) >>> 0;
    for (const byte of value) c = TABLE[(c ^ byte) & 255]! ^ (c >>> 8);
  }
}

/** A zip of files as they are (APPNOTE 6.3: stored, names in UTF-8). */
export async function zipped(files: Found[]): Promise<Blob> {
  const [parts, index]: [BlobPart[], BlobPart[]] = [[], []];
  let at = 0;
  for (const { path, file } of files) {
    const name = new TextEncoder().encode(path);
    const crc = await checksum(file);
    const shared = (view: DataView, from: number): void => {
      [20, 0x800, 0, 0, 0x21].forEach((value, k) => view.setUint16(from + 2 * k, value, true));
      [crc, file.size, file.size].forEach((value, k) => view.setUint32(from + 10 + 4 * k, value, true));
      view.setUint16(from + 22, name.length, true);
    };
    const [local, central] = [new DataView(new ArrayBuffer(30)), new DataView(new ArrayBuffer(46))];
    local.setUint32(0, 0x04034b50, true);
    shared(local, 4);
    central.setUint32(0, 0x02014b50, true);
    central.setUint16(4, 20, true);
    shared(central, 6);
    central.setUint32(42, at, true);
    parts.push(local.buffer, name, file);
    index.push(central.buffer, name);
    at += 30 + name.length + file.size;
  }
  const end = new DataView(new ArrayBuffer(22));
  end.setUint32(0, 0x06054b50, true);
  for (const place of [8, 10]) end.setUint16(place, files.length, true);
  end.setUint32(12, new Blob(index).size, true);
  end.setUint32(16, at, true);
  return new Blob([...parts, ...index, end.buffer]);
}

/** A place to drop on, beside a control for those who cannot; `said`: the command line that does the same. */
export function dropZone(folder: string, said: (command: string) => void): HTMLElement {
  const words = h("p", { class: "facts", "data-part": "bringing", role: "status" }, WORDS);
  const input = h("input", { type: "file", class: "unseen", tabindex: -1, "aria-label": "File to import", accept: [".zip", ...PICTURES].join(), change: () => void take([...(input.files ?? [])].map((file) => ({ path: file.name, file })), "") });
  const zone = h("section", { class: "drop" }, h("h2", {}, "Import"), button("Choose a file", () => input.click()), input, words);

  async function take(found: Found[], name: string): Promise<void> {
    const one = found.length === 1 && !found[0]!.path.includes("/") ? found[0]!.file : null;
    const called = one?.name ?? `${name || "session"}.zip`;
    try {
      if (!found.length) throw new Error("It contains no files");
      if (found.reduce((sum, each) => sum + each.file.size, 0) > MOST_BYTES) throw new Error("More than 4 GiB: copy the session's folder beside the others; it will appear here");
      said(one && !/\.zip$/i.test(one.name) ? `daylit process --panorama ${JSON.stringify(called)} --into ${folder}` : `daylit import ${JSON.stringify(called)} --into ${folder}`);
      words.textContent = `Importing ${called} …`;
      const made = await api.bring(called, one ?? (await zipped(found)));
      location.hash = `#/${encodeURIComponent(made)}/capture`;
    } catch (error) {
      note(`Not imported: ${(error as Error).message}`, true);
    }
    words.textContent = WORDS;
    input.value = "";
  }

  zone.addEventListener("dragover", (event) => {
    event.preventDefault();
    zone.classList.add("over");
  });
  zone.addEventListener("dragleave", () => zone.classList.remove("over"));
  zone.addEventListener("drop", (event) => {
    event.preventDefault();
    zone.classList.remove("over");
    const entries = [...(event.dataTransfer?.items ?? [])].map((item) => item.webkitGetAsEntry()).filter((entry) => entry !== null);
    void Promise.all(entries.map(within)).then((found) => take(found.flat(), entries[0]?.name ?? ""), () => note("This cannot be read as a file or folder", true));
  });
  return zone;
}
