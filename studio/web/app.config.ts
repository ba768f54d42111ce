// The studio's pages: what the server gives under /static.
import { defineConfig } from "vite";

export default defineConfig({
  base: "/static/",
  build: {
    outDir: "../static",
    emptyOutDir: true,
    target: "es2022",
    assetsInlineLimit: 0,
    reportCompressedSize: false,
    chunkSizeWarningLimit: 1000,
    rolldownOptions: { output: { postBanner: "/*! daylit, Apache-2.0; holds three.js, MIT, (c) 2010-2026 three.js authors */" } },
  },
});
