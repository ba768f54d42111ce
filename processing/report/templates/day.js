"use strict";
// One hour of the day at a time, chosen by a slider; without scripts, and on paper, all hours stand side by side.
document.querySelectorAll(".day:has([data-part=hour])").forEach((box) => {
  const cards = [...box.querySelectorAll(".card")];
  const [slider, said] = ["hour", "said"].map((name) => box.querySelector(`[data-part=${name}]`));

  function show() {
    cards.forEach((card, number) => card.classList.toggle("chosen", number === Number(slider.value)));
    said.textContent = cards[slider.value].dataset.title;
    slider.setAttribute("aria-valuetext", said.textContent);
  }

  box.classList.add("live");
  slider.addEventListener("input", show);
  show();
});
