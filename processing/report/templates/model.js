"use strict";
// Scenes in three dimensions: the chosen one is handed to <model-viewer>.
(function () {
  function setUp(box) {
    const viewer = box.querySelector("model-viewer");
    const choices = [...box.querySelectorAll("[data-model]")];
    const files = [...box.querySelectorAll(".model-data")];
    let url = "";

    function show(index) {
      const bytes = Uint8Array.from(atob(files[index].textContent), (c) => c.charCodeAt(0));
      if (url) URL.revokeObjectURL(url);
      url = URL.createObjectURL(new Blob([bytes], { type: "model/gltf-binary" }));
      viewer.setAttribute("alt", files[index].dataset.alt);
      viewer.setAttribute("src", url);
    }

    choices.forEach((choice, index) => choice.addEventListener("change", () => show(index)));
    viewer.addEventListener("load", () => box.classList.add("ready"));
    // Megabytes are unpacked when somebody comes near, not before.
    const near = new IntersectionObserver((seen) => {
      if (!seen.some((one) => one.isIntersecting)) return;
      near.disconnect();
      show(0);
    }, { rootMargin: "600px" });
    near.observe(box);
  }

  document.querySelectorAll(".models").forEach(setUp);
})();
