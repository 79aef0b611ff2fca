"use strict";
// The page around the scenes: episodes and filters, time, keys. All state is in `now`; `show` draws it.
(() => {
  const { $, OUTCOMES, CROWDS, bytes, element, mark } = Parts;
  const data = JSON.parse($("data").textContent);
  const { world, policies, episodes } = data;
  const SHORT = { success: "goal", collision_pedestrian: "pedestrian", collision_wall: "wall", timeout: "time out" };
  const INKS = ["accent", "second", "third"];

  // Numbers are stored as little-endian 16-bit integers (or bytes) in base 64.
  function numbers(text, units) {
    const view = new DataView(bytes(text).buffer), out = new Float32Array(view.byteLength / 2);
    for (let k = 0; k < out.length; k++) out[k] = view.getInt16(2 * k, true) * units[k % units.length];
    return out;
  }

  function open(run, episode, policy) {
    if (run.open) return run.open;
    const pedestrians = numbers(run.pedestrians, [0.01, 0.01, 0.001]);
    run.open = {
      robot: numbers(run.robot, [0.01, 0.01, 0.001]), command: numbers(run.command, [0.001, 0.001]),
      near: numbers(run.near, [0.01]), ranges: bytes(run.ranges), pedestrians,
      n: pedestrians.length / 3 / (run.steps + 1), goals: run.goals, goal: episode.goal, crowd: episode.crowd,
      steps: run.steps, outcome: run.outcome, token: policy.token, token_of_pedestrians: run.pedestrian_token,
      learned: run.pedestrian_token !== null,
    };
    return run.open;
  }

  const wish = new URLSearchParams(location.hash.slice(1));
  const still = wish.has("still") || matchMedia("(prefers-reduced-motion: reduce)").matches;
  // A link to a moment names its episode and its crowd; `crowd` and `filter` alone say which episodes are listed.
  const now = {
    shown: [], at: 0, time: 0, playing: !still, crowd: wish.get("crowd") || "", filter: wish.get("filter") || "",
    layers: { laser: true, trails: true, goals: true, speed: true },
  };

  const episode = () => now.shown[now.at];
  const length = () => Math.max(...episode().runs.map((run) => run.steps));
  const seconds = (steps) => (steps * world.dt).toFixed(1) + " s";

  // --- Filters and the list -------------------------------------------------------------------------------------

  const differs = (e) => e.runs.length > 1 && e.runs.some((run) => run.outcome !== e.runs[0].outcome);
  const isCollision = (e) => e.runs[0].outcome.startsWith("collision");
  const FILTERS = {
    "": () => true, collision: isCollision, differ: differs,
    ...Object.fromEntries(Object.keys(OUTCOMES).map((o) => [o, (e) => e.runs[0].outcome === o])),
  };

  function drawFilters() {
    const chip = (label, pressed, pick) => {
      const made = element("button", { class: "chip", "aria-pressed": String(pressed), onclick: pick }, label);
      return made;
    };
    const of_crowd = episodes.filter((e) => !now.crowd || e.crowd === now.crowd);
    const count = (name) => of_crowd.filter(FILTERS[name]).length;
    const kinds = [...new Set(episodes.map((e) => e.crowd))];
    const crowds = kinds.length < 2 ? [] : ["", ...kinds].map((kind) =>
      chip(kind || "All crowds", now.crowd === kind, () => { now.crowd = kind; choose(); }));
    const names = ["", ...Object.keys(OUTCOMES), ...(policies.length > 1 ? ["differ"] : [])];
    const outcomes = names.filter((name) => name === "" || name === now.filter || count(name) > 0).map((name) =>
      chip(`${name === "" ? "All" : SHORT[name] || "outcomes differ"} ${count(name)}`, now.filter === name,
        () => { now.filter = name; choose(); }));
    $("filters").replaceChildren(...crowds, ...(crowds.length ? [element("hr")] : []), ...outcomes);
  }

  function drawList() {
    $("none").hidden = now.shown.length > 0;
    $("episodes").replaceChildren(...now.shown.map((e, k) => {
      const runs = e.runs.map((run) => element("span", { class: "run" }, mark(run.outcome),
        element("span", {}, SHORT[run.outcome]), element("span", {}, seconds(run.steps))));
      const current = String(k === now.at);
      return element("li", {}, element("button", { "aria-current": current, onclick: () => go(k, now.playing) },
        element("span", { class: "number" }, String(e.episode)),
        element("span", { class: "crowd", style: `color:var(--${e.crowd})` }, e.crowd), element("span", {}, ...runs)));
    }));
  }

  function choose() {
    const fits = FILTERS[now.filter] || FILTERS[""];
    now.shown = episodes.filter((e) => (!now.crowd || e.crowd === now.crowd) && fits(e));
    drawFilters();
    if (now.shown.length === 0) now.shown = [], now.at = 0, drawList(), now.playing = false;
    else go(0, now.playing);
  }

  function go(k, play) {
    now.at = (k + now.shown.length) % now.shown.length;
    now.time = 0;
    now.playing = play;
    drawList();
    const current = $("episodes").querySelector('[aria-current="true"]');
    if (current) current.scrollIntoView({ block: "nearest", inline: "nearest" });
    drawLegend();
    show();
    link();
    tell();
  }

  // --- Views ----------------------------------------------------------------------------------------------------

  const VALUES = ["Time", "Speed", "Turning", "Nearest thing", "Way to goal"];
  const views = policies.map((policy, k) => Parts.view($("stage"), INKS[k], policy.name, policy.note, VALUES));

  function showView(view, k) {
    const run = open(episode().runs[k], episode(), policies[k]);
    const index = Math.min(Math.floor(now.time), run.steps), over = now.time >= run.steps;
    const next = Math.min(index + (over ? 0 : 1), run.steps);
    Scene.draw(view.canvas, view.width, world, run, Math.min(now.time, run.steps), Scene.colour(INKS[k]), now.layers);
    view.badge.textContent = over ? OUTCOMES[run.outcome] : "on its way";
    const label = `${policies[k].name}: ${view.badge.textContent}`;
    if (view.label !== label) view.canvas.setAttribute("aria-label", view.label = label);
    view.badge.style.color = over ? `var(--${run.outcome})` : "var(--muted)";
    const far = Math.hypot(run.robot[3 * index] - run.goal[0], run.robot[3 * index + 1] - run.goal[1]);
    const texts = [
      seconds(Math.min(now.time, run.steps)), run.command[2 * next].toFixed(2) + " m/s",
      run.command[2 * next + 1].toFixed(2) + " rad/s", run.near[index].toFixed(2) + " m", far.toFixed(1) + " m",
    ];
    view.values.forEach((value, i) => { value.textContent = texts[i]; });
  }

  function drawLegend() {
    if (!episode()) return;
    const { crowd } = episode(), token = episode().runs[0].pedestrian_token;
    const faded = element("span", { class: "scale" });
    $("legend").replaceChildren(
      element("span", {}, mark(crowd, true), `${crowd}: ${CROWDS[crowd]}${token === null ? "" : `, token ${token}`}`),
      element("span", {}, "0 ", faded, ` ${world.v_max} m/s`));
  }

  // --- The timeline: speed over time, one curve for each policy, and how it ended ------------------------------------

  function drawTimeline() {
    const canvas = $("timeline"), ratio = window.devicePixelRatio || 1;
    const width = canvas.clientWidth, height = canvas.clientHeight;
    canvas.width = Math.round(width * ratio);
    canvas.height = Math.round(height * ratio);
    const c = canvas.getContext("2d");
    c.setTransform(ratio, 0, 0, ratio, 0, 0);
    c.fillStyle = Scene.colour("panel");
    c.fillRect(0, 0, width, height);
    const total = length(), x = (step) => 10 + step / total * (width - 20), foot = height - 17;
    const y = (v) => foot - Math.max(0, v) / world.v_max * (foot - 20);
    c.strokeStyle = Scene.colour("line");
    c.fillStyle = Scene.colour("muted");
    c.font = "11px system-ui, sans-serif";
    c.textAlign = "center";
    const every = [1, 2, 5, 10, 20].find((s) => (width - 20) * s / (total * world.dt) > 46) || 40;
    for (let s = 0; s <= total * world.dt + 1e-6; s += every) {
      const at = x(s / world.dt);
      c.beginPath();
      c.moveTo(at, 6);
      c.lineTo(at, foot);
      c.stroke();
      c.fillText(s === 0 ? "0 s" : String(s), Math.max(at, 16), height - 4);
    }
    episode().runs.forEach((raw, k) => {
      const run = open(raw, episode(), policies[k]), ink = Scene.colour(INKS[k]);
      c.beginPath();
      for (let step = 1; step <= run.steps; step++) {
        c.lineTo(x(step - 1), y(run.command[2 * step]));
        c.lineTo(x(step), y(run.command[2 * step]));
      }
      c.strokeStyle = ink;
      c.lineWidth = 1.5;
      c.stroke();
      c.lineTo(x(run.steps), foot);
      c.lineTo(x(0), foot);
      c.globalAlpha = 0.12;
      c.fillStyle = ink;
      c.fill();
      c.globalAlpha = 1;
      c.fillStyle = Scene.colour(run.outcome);
      c.beginPath();
      c.arc(x(run.steps), foot, 4.5, 0, 2 * Math.PI);
      c.fill();
      c.lineWidth = 1;
    });
    c.fillStyle = Scene.colour("muted");
    c.textAlign = "left";
    c.fillText("speed of the robot", 18, 15);
    const at = x(now.time);
    c.strokeStyle = c.fillStyle = Scene.colour("ink");
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(at, 3);
    c.lineTo(at, foot);
    c.stroke();
    c.beginPath();
    c.arc(at, 5, 4, 0, 2 * Math.PI);
    c.fill();
    canvas.setAttribute("aria-valuemax", String(total));
    canvas.setAttribute("aria-valuenow", String(Math.round(now.time)));
    canvas.setAttribute("aria-valuetext", seconds(now.time));
  }

  function show() {
    if (!episode()) return;
    views.forEach(showView);
    drawTimeline();
    $("play").classList.toggle("playing", now.playing);
    const { crowd, episode: number } = episode();
    Object.assign(document.body.dataset, { crowd, episode: number, step: Math.floor(now.time), playing: now.playing });
  }

  function seek(step) {
    if (!episode()) return;
    now.time = Math.min(Math.max(0, step), length());
    show();
  }

  // --- What is shown, as an address and in words ---------------------------------------------------------------------

  function link() {
    if (!episode()) return location.href;
    return Parts.address({ in: episode().crowd, episode: episode().episode, t: Number((now.time * world.dt).toFixed(2)), crowd: now.crowd,
      filter: now.filter, still: now.playing ? null : "1", theme: wish.get("theme") });
  }

  // Goes to the moment of a fragment; an episode that the filters hide is shown among all.
  function follow(asked) {
    const is = (e) => String(e.episode) === asked.get("episode") && (!asked.has("in") || e.crowd === asked.get("in"));
    if (!now.shown.some(is) && episodes.some(is)) {
      now.crowd = now.filter = "";
      choose();
    }
    const at = now.shown.findIndex(is);
    if (at >= 0) go(at, now.playing);
    // 3.8 s divided by 0.1 s is a little less than 38 steps.
    if (asked.has("t")) seek(Math.round(Number(asked.get("t")) / world.dt * 1000) / 1000);
    link();
  }

  function tell() {
    const ends = episode().runs.map((run, k) => `${policies[k].name} ${OUTCOMES[run.outcome]} after ${seconds(run.steps)}`);
    Parts.say(`Episode ${episode().episode}, crowd ${episode().crowd}: ${ends.join("; ")}.`, false);
  }

  // --- Clock, keys, pointer -----------------------------------------------------------------------------------------

  let last = null, rested = 0;
  function tick(stamp) {
    const passed = last === null ? 0 : Math.min(0.1, (stamp - last) / 1000);
    last = stamp;
    if (now.playing && episode()) {
      if (now.time < length()) {
        rested = 0;
        seek(now.time + passed * Number($("rate").value) / world.dt);
      } else {
        // The end is held for a moment; then comes the next episode.
        rested += passed;
        if (rested > 1.2) { rested = 0; go(now.at + 1, true); }
      }
    }
    requestAnimationFrame(tick);
  }

  function play() {
    if (!episode()) return;
    now.playing = !now.playing;
    if (now.playing && now.time >= length()) now.time = 0;
    show();
    link();
  }

  const step = (by) => { now.playing = false; seek(Math.round(now.time + by)); link(); };
  const copy = () => $("share").click();
  const rate = (by) => { $("rate").selectedIndex = Math.min(5, Math.max(0, $("rate").selectedIndex + by)); };

  function measure() {
    views.forEach((view) => { view.canvas.style.width = view.canvas.style.height = "0"; });
    views.forEach((view) => { view.width = Parts.widthOf(view, world.site); });
  }

  function layout() {
    measure();
    show();
  }

  const turn = Parts.theme(wish.get("theme"), layout);

  Parts.keys({
    " ": play, ArrowLeft: (e) => step(e.shiftKey ? -10 : -1), ArrowRight: (e) => step(e.shiftKey ? 10 : 1),
    ArrowUp: () => go(now.at - 1, now.playing), ArrowDown: () => go(now.at + 1, now.playing), Home: () => seek(0),
    End: () => seek(Infinity), c: copy, "+": () => rate(1), "-": () => rate(-1), d: turn, ...Parts.layers(now.layers, show),
  }, episode);

  function scrub(event) {
    const box = $("timeline").getBoundingClientRect();
    now.playing = false;
    seek((event.clientX - box.left - 10) / (box.width - 20) * length());
    if (event.type === "pointerup") link();
  }

  $("timeline").addEventListener("pointerdown", (event) => {
    if (!episode()) return;
    $("timeline").setPointerCapture(event.pointerId);
    scrub(event);
  });
  $("timeline").addEventListener("pointermove", (event) => { if (event.buttons) scrub(event); });
  $("timeline").addEventListener("pointerup", (event) => { if (episode()) scrub(event); });
  addEventListener("hashchange", () => follow(new URLSearchParams(location.hash.slice(1))));
  Parts.share(link);
  $("play").addEventListener("click", play);
  $("back").addEventListener("click", (event) => step(event.shiftKey ? -10 : -1));
  $("forward").addEventListener("click", (event) => step(event.shiftKey ? 10 : 1));
  $("previous").addEventListener("click", () => go(now.at - 1, now.playing));
  $("next").addEventListener("click", () => go(now.at + 1, now.playing));
  addEventListener("resize", layout);

  const share = policies.map((policy, k) =>
    `${policy.name}: ${episodes.filter((e) => e.runs[k].outcome === "success").length} of ${episodes.length} reached the goal`);
  $("headline").textContent = share.join(" · ") + (data.note ? " · " + data.note : "");
  $("headline").title = policies.map((policy) => `${policy.name}: ${policy.note}`).join("\n");
  measure();
  choose();
  layout();
  follow(wish);
  requestAnimationFrame(tick);
})();
