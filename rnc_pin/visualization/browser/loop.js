// Controls of a loop in Python: pause, steps, the end, and sliders for gains.
"use strict";
(function () {
  const { make, send } = panel;
  let status = null, parts = {};
  panel.refresh = show;

  function pause() {
    send({ kind: "pause", value: !(status && status.paused) });
  }

  function build(given) {
    panel.clear("loop");
    parts = { gains: {} };
    make("h2", panel.element, "Loop");
    const buttons = make("div", panel.element, undefined, "buttons");
    parts.pause = panel.button(buttons, "Pause", pause);
    parts.step = panel.button(buttons, "Step", () => send({ kind: "step" }));
    panel.button(buttons, "End loop", () => send({ kind: "end" }));
    make("p", panel.element, "Space pauses, the right arrow key takes a step.", "hint");
    parts.messages = panel.list("messages");
    if (Object.keys(given.gains).length) make("h2", panel.element, "Gains");
    for (const name in given.gains) {
      parts.gains[name] = panel.slider(panel.element, name, given.gains[name], (value) => ({ kind: "gain", name, value }));
    }
    panel.scene();
    show();
  }

  function show() {
    if (!parts.messages) return;  // the controls have not come yet
    const ended = panel.offline ? ["the loop has ended, or this page may only watch"] : [];
    const told = status ? [...(status.running ? [] : ["the loop ends"]), status.message].filter((each) => each) : [];
    panel.lines(parts.messages, [...ended, ...told], "goal");
    if (!status) return;
    parts.pause.textContent = status.paused ? "Continue" : "Pause";
    parts.step.disabled = !status.paused;
    for (const name in status.gains) parts.gains[name](status.gains[name]);
  }

  document.addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") pause();
    else if (event.code === "ArrowRight") send({ kind: "step" });
    else return;
    event.preventDefault();
  });

  panel.listen({
    loop_controls: (command) => build(command.content),
    loop_status: (command) => { status = command.content; show(); },
  });
})();
