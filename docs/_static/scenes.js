// A picture that has a recorded scene gets a button; a click puts the scene into the place of the picture.
(() => {
  const root = document.documentElement.dataset.content_root || "./";
  const names = new Set(window.sceneNames || []);
  for (const picture of document.querySelectorAll("article img")) {
    const name = decodeURIComponent(picture.src.split("/").pop()).replace(/\.\w+$/, "");
    if (!names.has(name) || picture.closest("table")) continue;
    const frame = document.createElement("div");
    frame.className = "scene";
    const button = document.createElement("button");
    button.type = "button";
    button.textContent = "▶ Interactive 3D scene";
    const outer = picture.closest("a") || picture;
    outer.replaceWith(frame);
    frame.append(outer, button);
    button.addEventListener("click", () => {
      const page = document.createElement("iframe");
      page.src = `${root}scenes/${name}.html`;
      page.title = picture.alt || name;
      page.loading = "lazy";
      page.allowFullscreen = true;
      frame.replaceChildren(page);
    });
  }
})();
