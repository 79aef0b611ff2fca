"use strict";
// What the replay and the live page have in common beside the drawing: words, small elements, light and dark.
const Parts = (() => {
  const $ = (id) => document.getElementById(id);
  const OUTCOMES = {
    success: "reached its goal", collision_pedestrian: "hit a pedestrian", collision_wall: "hit a wall", timeout: "ran out of time",
  };
  const CROWDS = {
    NH: "learned pedestrians", IN: "learned, blind to the robot", VA: "learned, at various speeds, blind to the robot",
    SO: "learned, half trained", VO: "velocity obstacles (ORCA)", SF: "social force",
    straight: "straight to their goals, blind", "stop-and-go": "straight, with stops, blind", "cross-play": "learned, of other seeds",
    recorded: "people as they walked, blind to the robot",
  };
  const LAYERS = { laser: ["Laser", "l"], trails: ["Trails", "t"], goals: ["Goals", "g"], speed: ["Arrows", "a"] };

  function bytes(text) {
    const raw = atob(text), out = new Uint8Array(raw.length);
    for (let k = 0; k < raw.length; k++) out[k] = raw.charCodeAt(k);
    return out;
  }

  function element(tag, attributes, ...children) {
    const made = document.createElement(tag);
    for (const [key, value] of Object.entries(attributes || {})) {
      if (key === "class") made.className = value;
      else if (key.startsWith("on")) made.addEventListener(key.slice(2), value);
      else made.setAttribute(key, value);
    }
    made.append(...children);
    return made;
  }

  const mark = (name, square) => element("span", { class: square ? "mark square" : "mark", style: `background:var(--${name})` });

  // A canvas with its heading and a list of values; gives what is to be filled in.
  function view(stage, ink, name, note, values) {
    const canvas = element("canvas", { role: "img" }), badge = element("span", { class: "badge" });
    const cells = values.map((value) => [value, element("dd")]), title = element("b", {}, name);
    const node = element("div", { class: "view" }, element("h2", { title: note }, mark(ink, true), title, badge),
      element("div", { class: "frame" }, canvas),
      element("dl", {}, ...cells.map(([value, cell]) => element("div", {}, element("dt", {}, value), cell))));
    stage.append(node);
    return { canvas, badge, title, node, values: cells.map(([, cell]) => cell), frame: node.querySelector(".frame") };
  }

  // The widest canvas that the frame of a view holds.
  function widthOf(view, site) {
    const box = Scene.bounds(site), wide = (box.right - box.left + 0.7) / (box.top - box.bottom + 0.7);
    const narrow = matchMedia("(max-width: 820px)").matches;
    const height = narrow ? Infinity : view.frame.clientHeight;
    return Math.max(160, Math.floor(Math.min(view.frame.clientWidth, height * wide)));
  }

  // Buttons for the layers, each with its key; `changed` is called after a layer was switched.
  function layers(shown, changed) {
    const turn = (name) => {
      shown[name] = !shown[name];
      $("layer-" + name).setAttribute("aria-pressed", String(shown[name]));
      changed();
    };
    for (const [name, [label, key]] of Object.entries(LAYERS)) {
      $("layers").append(element("button", { class: "chip", id: "layer-" + name, "aria-pressed": "true", title: `Key ${key}`,
        onclick: () => turn(name) }, label));
    }
    return Object.fromEntries(Object.entries(LAYERS).map(([name, [, key]]) => [key, () => turn(name)]));
  }

  // Light or dark: as wished, else as the system has it.
  function theme(wished, changed) {
    const set = (name) => { document.documentElement.dataset.theme = name; };
    set(wished || (matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light"));
    const turn = () => { set(document.documentElement.dataset.theme === "dark" ? "light" : "dark"); changed(); };
    $("theme").addEventListener("click", turn);
    return turn;
  }

  // Calls what a key stands for, but where a form field or a focused button wants the key.
  function keys(acts, ready) {
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || !ready()) return;
      const { tagName, type } = event.target;
      if (tagName === "SELECT" || (tagName === "INPUT" && type !== "radio")) return;
      const act = acts[event.key];
      if (!act || (event.key === " " && tagName === "BUTTON")) return;
      event.preventDefault();
      act(event);
    });
  }

  // The address of what is shown: the page's own with a fragment. It changes with the page, so that reload and bookmark work, too.
  let later = null;
  function address(parts) {
    const link = new URL(location.href);
    link.hash = new URLSearchParams(Object.entries(parts).filter(([, value]) => value !== "" && value !== null));
    // Browsers object to many changes in a second, as a held key would make.
    clearTimeout(later);
    later = setTimeout(() => history.replaceState(null, "", link.hash), 150);
    return link.href;
  }

  // A button that copies the address; where the browser allows no copying, it is in the address line all the same.
  function share(address) {
    $("share").addEventListener("click", async () => {
      const link = address();
      const copied = await navigator.clipboard?.writeText(link).then(() => true, () => false);
      say(copied ? "The link to this moment is copied." : "The link to this moment is in the address line.");
    });
  }

  // Says something to a screen reader; `show` lets eyes see it for a while, too.
  let quiet = null;
  function say(text, show = true) {
    $("said").textContent = text;
    $("said").classList.toggle("shown", show);
    clearTimeout(quiet);
    if (show) quiet = setTimeout(() => $("said").classList.remove("shown"), 4000);
  }

  return { $, address, share, say, OUTCOMES, CROWDS, bytes, element, mark, view, widthOf, layers, theme, keys };
})();
