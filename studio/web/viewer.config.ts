// The viewer of the report: one classic script that stands in the page itself and runs from disk.
import { defineConfig } from "vite";

export default defineConfig({
  build: {
    lib: { entry: "src/viewer/report.ts", formats: ["iife"], name: "daylit", fileName: () => "viewer.js" },
    outDir: "../../processing/report/static",
    emptyOutDir: true,
    target: "es2022",
    minify: true,
    reportCompressedSize: false,
    rolldownOptions: { output: { postBanner: "/*! daylit, Apache-2.0; holds three.js, MIT, (c) 2010-2026 three.js authors */" } },
  },
});
