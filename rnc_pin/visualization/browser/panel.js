// Panel of controls: what users do becomes messages to the server. It shows sliders, messages and the verdict; the
// script of a page adds what only this page has.
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

  // Sliders that follow the values of the status.
  let followers = {};
  own.sliders = (title, ranges, command) => {
    if (!Object.keys(ranges).length) return;
    make("h2", own.element, title);
    for (const name in ranges) {
      followers[name] = own.slider(own.element, name, ranges[name], (value) => command(name, value));
    }
  };

  own.hint = (text) => make("p", own.element, text, "hint");

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

  // ---- messages of the server beside drawing commands

  // The server tells once which controls there are, then their status again and again, and at the end a verdict.
  own.serve = (id, name, { build, show }) => {
    let messages = null, status = null, verdict = null;
    own.refresh = () => {
      if (!messages) return;  // the controls have not come yet
      const ended = own.offline ? ["the " + name + " has ended, or this page may only watch"] : [];
      if (verdict) own.lines(messages, [verdict.headline, ...verdict.findings], verdict.word);
      else own.lines(messages, [...ended, ...(status ? status.messages : [])], "goal");
      if (!status) return;
      for (const each in status.values) followers[each]?.(status.values[each]);
      show(status);
    };
    const own_types = {
      panel_controls: (given) => {
        own.element.id = id;
        own.element.replaceChildren();
        followers = {};
        document.body.classList.add("with-panel");
        window.dispatchEvent(new Event("resize"));  // the picture has another size beside a panel
        build(given);
        messages = document.getElementById("messages");
        own.scene();
      },
      panel_status: (given) => { status = given; },
      panel_verdict: (given) => { verdict = given; },
    };
    const others = viewer.handle_command.bind(viewer);
    viewer.handle_command = (command) => {
      if (!own_types[command.type]) return others(command);
      own_types[command.type](command.content);
      own.refresh();
    };
  };

  return own;
})();
