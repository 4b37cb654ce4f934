// ControlPanel of controls: what users do becomes messages to the server; the pages build on it.
"use strict";
const panel = (function () {
  const make = (tag, parent, text, kind) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    if (kind) made.className = kind;
    return parent.appendChild(made);
  };

  // ---- connection

  const secret = location.hash.slice(1);
  const socket = new WebSocket("ws://" + location.host + "/commands");
  const own = { make, offline: false, refresh: () => {} };
  socket.onopen = () => socket.send(JSON.stringify({ secret }));
  socket.onclose = () => { own.offline = true; own.refresh(); };
  own.send = (command) => {
    if (command && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify(command));
  };

  // ---- elements

  own.element = make("div", document.body, undefined, "panel");

  own.clear = (id) => {
    own.element.id = id;
    own.element.replaceChildren();
    document.body.classList.add("with-panel");
    window.dispatchEvent(new Event("resize"));  // the picture has another size beside a panel
  };

  own.slider = (parent, name, range, command) => {
    const line = make("label", parent, undefined, "slider");
    make("span", line, name.replaceAll("_", " ")).title = name;
    const input = make("input", line), shown = make("output", line);
    Object.assign(input, { type: "range", min: range.lower, max: range.upper, step: (range.upper - range.lower) / 400 });
    input.value = range.start;
    const show = () => { shown.value = Number(input.value).toFixed(2) + (range.unit === "m" ? " m" : ""); };
    input.addEventListener("input", () => { show(); own.send(command(Number(input.value))); });
    input.addEventListener("change", () => input.blur());  // or the arrow keys would move the slider
    show();
    return (value) => { if (document.activeElement !== input) { input.value = value; show(); } };
  };

  own.button = (parent, text, action, kind) => {
    const made = make("button", parent, text, kind);
    made.addEventListener("click", () => { action(); made.blur(); });
    return made;
  };

  own.lines = (list, texts, kind) => {
    const old = [...list.children].map((each) => each.textContent);
    if (old.join("\n") === texts.join("\n")) return;
    list.replaceChildren();
    for (const text of texts) make("li", list, text, kind);
  };

  own.list = (id) => {
    const made = make("ul", own.element);
    made.id = id;
    return made;
  };

  // Meshcat's own controls would cover the panel.
  own.scene = () => {
    const scene = make("details", own.element);
    make("summary", scene, "Scene");
    scene.append(viewer.gui.domElement);
    viewer.gui.open();
  };

  // Messages of the server beside drawing commands: a function for each type.
  own.listen = (handlers) => {
    const others = viewer.handle_command.bind(viewer);
    viewer.handle_command = (command) => {
      if (handlers[command.type]) handlers[command.type](command);
      else others(command);
    };
  };

  return own;
})();
