// Controls of a driven run: keys, clicks and sliders become commands; the status of the run comes back.
"use strict";
(function () {
  const { make, send, slider, lines } = panel;
  window.drive_command = send;

  // ---- panel

  let controls = null, status = null, chosen = null, parts = {};
  const heights = {};  // z of the goals that clicks set [m]

  function build(given) {
    controls = given;
    const title = make("h2", panel.element, "Drive");
    parts.factor = make("span", title, "1.00 x", "factor");
    parts.factor.title = "simulated time over real time";
    const targets = [...(given.base ? ["base"] : []), ...Object.keys(given.frames)];
    if (targets.length) {
      make("h2", panel.element, "A click on the ground moves");
      for (const name of targets) {
        const line = make("label", panel.element);
        const radio = make("input", line);
        Object.assign(radio, { type: "radio", name: "target", value: name });
        radio.addEventListener("change", () => { chosen = name; radio.blur(); });
        make("span", line, name.replaceAll("_", " "));
        if (chosen === null || chosen === name) { chosen = name; radio.checked = true; }
      }
    }
    const buttons = make("div", panel.element, undefined, "buttons");
    const button = (text, action, kind) => panel.button(buttons, text, action, kind);
    button("Stop", stop, "stop");
    if (Object.keys(given.frames).length) {
      button("Release frames", () => { for (const frame in given.frames) send({ kind: "release_frame", frame }); });
    }
    button("End run", () => send({ kind: "end" }));
    if (given.base) {
      const line = make("label", panel.element);
      const box = make("input", line);
      box.type = "checkbox";
      box.addEventListener("change", () => { send({ kind: "hold_base", on: box.checked }); box.blur(); });
      make("span", line, "base stays while frames move");
      panel.hint("Arrows or W A S D drive" + (given.base.slides ? ", Q E slide" : "") + ", space stops.");
    }
    if (Object.values(given.frames).some((axes) => axes[2])) {
      panel.hint("R and F move the goal up and down.");
    }
    make("h2", panel.element, "Active limits");
    parts.limits = panel.list("limits");
    panel.list("messages");
    panel.sliders("Posture", given.joints, (joint, position) => ({ kind: "joint_goal", joint, position }));
    const more = make("details", panel.element);
    make("summary", more, "Gains and speeds");
    for (const gain in given.gains) {
      slider(more, gain, given.gains[gain], (value) => ({ kind: "gain", gain, value }));
    }
  }

  function show(given) {
    status = given;
    parts.factor.textContent = given.factor.toFixed(2) + " x";
    parts.factor.classList.toggle("late", given.factor < 0.95);
    lines(parts.limits, given.limits);
  }

  // ---- keys

  const directions = {
    ArrowUp: ["forward", 1], KeyW: ["forward", 1], ArrowDown: ["forward", -1], KeyS: ["forward", -1],
    ArrowLeft: ["turn", 1], KeyA: ["turn", 1], ArrowRight: ["turn", -1], KeyD: ["turn", -1],
    KeyQ: ["left", 1], KeyE: ["left", -1],
  };
  const held = new Set();

  function drive() {
    const velocity = { forward: 0, turn: 0, left: 0 };
    for (const code of held) velocity[directions[code][0]] += directions[code][1];
    for (const name in velocity) velocity[name] = Math.max(-1, Math.min(1, velocity[name]));
    send({ kind: "base_velocity", ...velocity });
  }

  function stop() {
    held.clear();
    send({ kind: "stop" });
  }

  const writing = (event) => event.target instanceof HTMLElement && event.target.matches("input[type=text], textarea");

  document.addEventListener("keydown", (event) => {
    if (writing(event) || event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.code === "Space") stop();
    else if (controls && controls.base && directions[event.code]) {
      held.add(event.code);
      if (!event.repeat) drive();
    } else if (event.code === "KeyR" || event.code === "KeyF") raise(event.code === "KeyR" ? 0.02 : -0.02);
    else return;
    event.preventDefault();
  });
  const release = () => {
    if (held.size) { held.clear(); drive(); }
  };
  document.addEventListener("keyup", (event) => {
    if (held.delete(event.code)) drive();
  });
  window.addEventListener("blur", release);
  // The velocity of the base ends by itself 0.5 s after the last command.
  setInterval(() => { if (held.size) drive(); }, 150);

  // ---- clicks

  function point(event, height) {
    const box = viewer.renderer.domElement.getBoundingClientRect();
    const x = 2 * (event.clientX - box.left) / box.width - 1, y = 1 - 2 * (event.clientY - box.top) / box.height;
    const eye = viewer.camera.position;
    const far = eye.clone().set(x, y, 0.5).unproject(viewer.camera);
    const slope = far.y - eye.y;  // the y axis of the camera's coordinates points up
    const along = (height - eye.y) / slope;
    if (!Number.isFinite(along) || along <= 0) return null;
    const found = [eye.x + along * (far.x - eye.x), -(eye.z + along * (far.z - eye.z)), height];
    return Math.hypot(found[0], found[1]) < 99 ? found : null;
  }

  const place_of = (name) => (status && (status.goals[name] || status.places[name])) || [0, 0, 0];

  function command_to(name, position) {
    if (name === "base") send({ kind: "base_goal", x: position[0], y: position[1] });
    else send({ kind: "frame_goal", frame: name, position });
  }

  function raise(by) {
    if (!chosen || chosen === "base") return;
    const [x, y, z] = place_of(chosen);
    const aimed = heights[chosen] && Date.now() - heights[chosen].when < 400 ? heights[chosen].z : z;
    heights[chosen] = { z: aimed + by, when: Date.now() };  // keys may repeat faster than the status comes
    command_to(chosen, [x, y, heights[chosen].z]);
  }

  let pressed = null;
  const pane = document.getElementById("meshcat-pane");
  pane.addEventListener("pointerdown", (event) => { pressed = event.button === 0 ? event : null; }, true);
  pane.addEventListener("pointerup", (event) => {
    const near = pressed && Math.hypot(event.clientX - pressed.clientX, event.clientY - pressed.clientY) < 5;
    if (!near || event.timeStamp - pressed.timeStamp > 500 || !controls || !chosen) return;
    const found = point(event, chosen === "base" ? controls.ground : place_of(chosen)[2]);
    if (found) command_to(chosen, found);
  }, true);

  panel.serve("drive", "run", { build, show });
})();
