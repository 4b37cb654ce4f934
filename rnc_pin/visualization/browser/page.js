// Extensions of Meshcat's viewer: camera commands, copies of nodes, a overlay with a legend, a player.
"use strict";
var viewer = new MeshCat.Viewer(document.getElementById("meshcat-pane"));
viewer.gui.domElement.style.zIndex = 1;
// Meshcat takes the height of the window, but a panel may leave less to the picture.
viewer.set_3d_pane_size = function (width, height) {
  const pane = this.dom_element;
  MeshCat.Viewer.prototype.set_3d_pane_size.call(this, width ?? pane.offsetWidth, height ?? pane.offsetHeight);
};

(function () {
  const element = (tag, parent, text) => {
    const made = document.createElement(tag);
    if (text !== undefined) made.textContent = text;
    return parent.appendChild(made);
  };
  const split = (path) => path.split("/").filter((part) => part.length > 0);
  const node = (path) => viewer.scene_tree.find(split(path));

  // ---- commands in addition to Meshcat's

  const WIDEST = 1.5;  // width over height of a picture that has room for the motion alone
  let away = 1;  // distance of the camera over the one for a wide picture

  const narrowness = () => Math.max(1, WIDEST / viewer.camera.aspect);

  window.addEventListener("resize", () => {
    const before = away, { position } = viewer.camera, { target } = viewer.controls;
    away = narrowness();
    position.sub(target).multiplyScalar(away / before).add(target);
    viewer.controls.update();
    viewer.set_dirty();
  });

  // Depths are accurate if the nearest visible depth is no tiny part of the distance; otherwise surfaces flicker.
  function keep_depth() {
    const near = Math.max(0.01, 0.02 * viewer.camera.position.distanceTo(viewer.controls.target));
    if (Math.abs(near / viewer.camera.near - 1) < 0.05) return;
    viewer.camera.near = near;
    viewer.camera.updateProjectionMatrix();
  }
  viewer.controls.addEventListener("change", keep_depth);

  function look(command) {
    // The y axis of the camera's coordinates points up.
    const turned = ([x, y, z]) => [x, z, -y];
    away = narrowness();
    viewer.camera.position.set(...turned(command.position.map((at, k) => command.target[k] + away * (at - command.target[k]))));
    viewer.camera.fov = command.fov;
    viewer.camera.far = command.far;
    viewer.controls.target.set(...turned(command.target));
    viewer.controls.update();
    keep_depth();
    const [x, y, z] = command.target;
    node("/Lights").object.position.set(x, y, z);
    followed = [0, 0, 0];
  }

  // The camera moves by the change of the offset, so movements by the user remain.
  let followed = [0, 0, 0], track = null;

  function follow(offset) {
    const [x, y, z] = offset.map((value, k) => value - followed[k]);
    if (x === 0 && y === 0 && z === 0) return;
    followed = offset;
    for (const each of [viewer.camera.position, viewer.controls.target]) {
      each.set(each.x + x, each.y + z, each.z - y);
    }
    viewer.controls.update();
    const lights = node("/Lights").object.position;
    lights.set(lights.x + x, lights.y + y, lights.z + z);
    viewer.set_dirty();
  }

  function copy(command) {
    const pale = (material) => {
      const made = material.clone();
      made.transparent = true;
      made.opacity = command.opacity;
      made.depthWrite = command.opacity > 0.99;
      // Where a copy and its source coincide, the source is in front; otherwise both would flicker.
      Object.assign(made, { polygonOffset: true, polygonOffsetFactor: 2, polygonOffsetUnits: 8 });
      if (made.color) made.color.setHex(command.color);
      return made;
    };
    const made = node(command.source + "/<object>").object.clone();
    if (made.material) {
      made.material = Array.isArray(made.material) ? made.material.map(pale) : pale(made.material);
    }
    made.castShadow = false;
    viewer.set_object(split(command.path), made);
  }

  let cells = [], series = null;

  function overlay(command) {
    const home = document.getElementById("overlay");
    home.replaceChildren();
    if (command.title) element("h1", home, command.title);
    const table = element("table", home);
    cells = command.rows.map((row) => {
      const line = element("tr", table);
      const name = element("td", line, row.label);
      const value = element("td", line);
      value.className = "value";
      let chip = null;
      if (row.chip) {
        chip = document.createElement("span");
        chip.className = "chip";
        name.prepend(chip);
      }
      return { value, chip, unit: row.unit };
    });
    const legend = document.getElementById("legend");
    legend.replaceChildren();
    for (const entry of command.legend) {
      const button = element("button", legend);
      const sign = element("i", button);
      sign.className = entry.sign;
      sign.style[entry.sign === "dot" ? "background" : "borderColor"] = entry.color;
      sign.style.color = entry.color;
      element("span", button, entry.label);
      button.title = "show or hide";
      const target = () => node(entry.path);
      button.classList.toggle("off", !entry.visible);
      button.addEventListener("click", () => {
        const controller = target().vis_controller;
        controller.setValue(!target().object.visible);
        button.classList.toggle("off", !target().object.visible);
      });
    }
    series = command.frames ? command : null;
  }

  function text_of(value, unit) {
    if (value === null || Number.isNaN(value)) return "–";
    const size = Math.abs(value);
    const text = size >= 100 ? value.toFixed(0) : size >= 10 ? value.toFixed(1) : value.toFixed(size >= 1 ? 2 : 4);
    return unit ? text + " " + unit : text;
  }

  function show_values(values, chips) {
    cells.forEach((cell, k) => {
      cell.value.textContent = text_of(values[k], cell.unit);
      if (cell.chip && chips && chips[k]) cell.chip.style.background = chips[k];
    });
  }

  const own = {
    look, copy, overlay,
    follow: (command) => follow(command.offset),
    track: (command) => { track = command; },
    overlay_values: (command) => show_values(command.values, command.chips),
  };
  const theirs = viewer.handle_command.bind(viewer);
  viewer.handle_command = (command) => {
    if (own[command.type]) {
      own[command.type](command);
      viewer.set_dirty();
    } else {
      theirs(command);
    }
  };

  // A message contains several commands; the size of each precedes it.
  function handle_bundle(bytes) {
    const view = new DataView(bytes.buffer, bytes.byteOffset);
    for (let at = 0; at < bytes.length;) {
      const size = view.getUint32(at, true);
      viewer.handle_command_bytearray(bytes.subarray(at + 4, at + 4 + size));
      at += 4 + size;
    }
  }
  viewer.handle_command_message = (message) => handle_bundle(new Uint8Array(message.data));

  // ---- recording: all commands, then the player

  async function unpack(text) {
    const packed = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
    const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
    return new Uint8Array(await new Response(stream).arrayBuffer());
  }

  function start_player(begin) {
    const animator = viewer.animator;
    const seek = animator.seek.bind(animator);
    animator.seek = (time) => {
      seek(time);
      animator.display_progress(Math.max(0, Math.min(time, animator.duration)));
    };
    const [button, slider, clock, speed] = ["play", "slider", "clock", "speed"].map((id) => document.getElementById(id));
    slider.max = animator.duration;
    button.addEventListener("click", () => (animator.playing ? animator.pause() : animator.play()));
    slider.addEventListener("input", () => {
      animator.pause();
      animator.seek(Number(slider.value));
    });
    speed.addEventListener("change", () => { animator.mixer.timeScale = Number(speed.value); });
    document.getElementById("player").hidden = false;
    viewer.gui.domElement.style.display = "none";  // the player and the legend have what a recording needs
    let shown = -1;
    const refresh = () => {
      button.textContent = animator.playing ? "❚❚" : "▶";
      if (animator.time !== shown) {
        shown = animator.time;
        slider.value = shown;
        if (track) follow(track.offsets[Math.min(Math.round(shown * track.rate), track.offsets.length - 1)]);
        clock.value = shown.toFixed(2) + " / " + animator.duration.toFixed(2) + " s";
        if (series) {
          const frame = Math.min(Math.round(shown * series.rate), series.frames.length - 1);
          show_values(series.frames[frame], series.chips && series.chips[frame]);
        }
      }
    };
    const draw = viewer.animate.bind(viewer);
    viewer.animate = () => { refresh(); draw(); };
    if (begin !== null) {
      animator.pause();
      animator.seek(begin);
    }
    refresh();
  }

  window.play_recording = async (text, begin = null) => {
    handle_bundle(await unpack(text));
    start_player(begin);
    window.ready = true;
  };
})();
