// Controls of a loop in Python: pause, steps, the end, and sliders for gains.
"use strict";
(function () {
  const { make, send } = panel;
  let paused = false, parts = {};

  function pause() {
    send({ kind: "pause", value: !paused });
  }

  function build(given) {
    make("h2", panel.element, "Loop");
    const buttons = make("div", panel.element, undefined, "buttons");
    parts.pause = panel.button(buttons, "Pause", pause);
    parts.step = panel.button(buttons, "Step", () => send({ kind: "step" }));
    panel.button(buttons, "End loop", () => send({ kind: "end" }));
    panel.hint("Space pauses, the right arrow key takes a step.");
    panel.list("messages");
    panel.sliders("Gains", given.gains, (name, value) => ({ kind: "gain", name, value }));
  }

  function show(status) {
    paused = status.paused;
    parts.pause.textContent = paused ? "Continue" : "Pause";
    parts.step.disabled = !paused;
  }

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") pause();
    else if (event.code === "ArrowRight") send({ kind: "step" });
    else return;
    event.preventDefault();
  });

  panel.serve("loop", "loop", { build, show });
})();
