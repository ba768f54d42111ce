"use strict";
// Two states of the room in one frame, divided where the slider stands.
(function () {
  function setUp(box) {
    const scenes = [...box.querySelectorAll(".scene")];
    const [left, right] = ["left", "right"].map((name) => box.querySelector(`[data-part=${name}]`));
    const slider = box.querySelector("[data-part=divide]");

    function show() {
      for (const shot of box.querySelectorAll(".shot")) {
        const name = shot.dataset.name;
        shot.classList.toggle("on-left", name === left.value);
        shot.classList.toggle("on-right", name === right.value);
        if (name === left.value) box.querySelector("[data-part=left-name]").textContent = shot.dataset.tag;
        if (name === right.value) box.querySelector("[data-part=right-name]").textContent = shot.dataset.tag;
      }
      divide();
    }

    function divide() {
      box.style.setProperty("--divide", `${slider.value}%`);
      slider.setAttribute("aria-valuetext", `${slider.value} % ${left.value}, the rest ${right.value}`);
    }

    box.classList.add("live");
    for (const one of [left, right]) one.addEventListener("change", show);
    slider.addEventListener("input", divide);
    for (const choice of box.querySelectorAll("[data-scene]"))
      choice.addEventListener("change", () => {
        for (const scene of scenes) scene.classList.toggle("chosen", scene.dataset.name === choice.value);
      });
    show();
  }

  document.querySelectorAll(".comparison").forEach(setUp);
})();
