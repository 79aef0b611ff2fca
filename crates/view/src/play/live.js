"use strict";
// The live page: what the server tells is kept as a run, as a replay has it, and drawn by the same scene.
(() => {
  const { $, OUTCOMES, CROWDS, bytes, element, mark } = Parts;
  const KEEP = 600; // Steps of the past that are kept at least.
  const RETRY = 1500; // Milliseconds between two attempts to connect.
  const VALUES = ["Time", "Speed", "Turning", "Nearest thing", "Way to goal"];
  const TOOLS = ["goal", "pedestrian", "obstacle"];
  const now = { first: true, world: null, run: null, setup: null, playing: false, times: 1, came: 0, step: -1, episode: -1, policies: [],
    layers: { laser: true, trails: true, goals: true, speed: true } };
  const view = Parts.view($("stage"), "accent", "", "", VALUES);
  let socket = null;

  const ask = (what, more) => {
    if (socket && socket.readyState === WebSocket.OPEN) socket.send(JSON.stringify({ do: what, ...more }));
  };

  // --- What the server tells ----------------------------------------------------------------------------------------

  function option(value, label, disabled) {
    const made = element("option", { value: String(value) }, label);
    made.disabled = Boolean(disabled);
    return made;
  }

  // A link names the policy, as another server may offer others; what it leaves out is as the server has it.
  function follow() {
    const wish = new URLSearchParams(location.hash.slice(1));
    if (!["policy", "crowd", "pedestrians", "token", "seed", "episode"].some((name) => wish.has(name))) return false;
    const at = now.policies.findIndex((policy) => policy.name === wish.get("policy"));
    const number = (name, otherwise) => (wish.has(name) ? Number(wish.get(name)) : otherwise);
    const { setup } = now;
    ask("setup", { crowd: wish.get("crowd") || setup.crowd, pedestrians: number("pedestrians", setup.pedestrians),
      policy: at < 0 ? setup.policy : at, token: number("token", 0), seed: number("seed", setup.seed), episode: number("episode", 0) });
    return true;
  }

  function link() {
    const { setup, episode } = now;
    if (!setup) return location.href;
    const policy = (now.policies[setup.policy] || {}).name;
    return Parts.address({ policy, crowd: setup.crowd, pedestrians: setup.pedestrians, token: setup.token || null, seed: setup.seed, episode });
  }

  function choices({ policies, crowds, pedestrians_max }) {
    now.policies = policies;
    $("policy").replaceChildren(...policies.map((policy, k) => option(k, policy.name)));
    $("crowd").replaceChildren(...Object.keys(CROWDS).filter((crowd) => crowd !== "recorded").map((crowd) => {
      const has = crowds.includes(crowd);
      return option(crowd, has ? `${crowd}: ${CROWDS[crowd]}` : `${crowd}: needs --pool`, !has);
    }));
    $("pedestrians").max = String(pedestrians_max);
    tokens();
  }

  function tokens() {
    const policy = now.policies[$("policy").value] || { tokens: 0 };
    const count = Math.max(1, policy.tokens);
    $("token").replaceChildren(...Array.from({ length: count }, (_, k) => option(k, policy.tokens ? String(k) : "none")));
    $("token").disabled = count < 2;
  }

  function room({ scene, setup, episode, policy, learned }) {
    now.world = scene;
    if (episode !== now.episode || JSON.stringify(setup) !== JSON.stringify(now.setup)) now.run = null;
    Object.assign(now, { setup, episode });
    now.learned = learned;
    for (const name of ["policy", "crowd", "pedestrians", "seed"]) $(name).value = String(setup[name]);
    tokens();
    $("token").value = String(setup.token);
    view.title.textContent = policy;
    $("headline").textContent = `${(now.policies[setup.policy] || {}).note || ""} · crowd ${setup.crowd}, seed ${setup.seed}, episode ${episode}`;
    $("headline").title = $("headline").textContent;
    $("legend").replaceChildren(element("span", {}, mark(setup.crowd, true), `${setup.crowd}: ${CROWDS[setup.crowd]}`),
      element("span", {}, "0 ", element("span", { class: "scale" }), ` ${scene.v_max} m/s`));
    measure();
    // The first room is the server's; a visitor who came by a link gets that of the link.
    const followed = now.first && follow();
    now.first = false;
    if (!followed) link();
  }

  function clock({ playing, times }) {
    Object.assign(now, { playing, times });
    $("play").classList.toggle("playing", playing);
    $("rate").value = String(times);
  }

  function begin(frame) {
    const policy = now.policies[now.setup.policy] || { tokens: 0 };
    now.run = { robot: [], command: [], near: [], ranges: [], pedestrians: [], n: frame.pedestrians.length, goals: [], goal: frame.goal,
      crowd: now.setup.crowd, steps: -1, outcome: null, token: policy.tokens ? now.setup.token : null,
      token_of_pedestrians: now.learned ? 0 : null, learned: now.learned };
  }

  // Steps of the past are as long as the present one: who came later stood where they came.
  function widen(run, poses) {
    const wider = [], n = poses.length;
    for (let step = 0; step <= run.steps; step++) {
      for (let body = 0; body < n; body++) {
        const from = (step * run.n + body) * 3;
        wider.push(...(body < run.n ? run.pedestrians.slice(from, from + 3) : poses[body]));
      }
    }
    Object.assign(run, { pedestrians: wider, n });
  }

  function drop(run, steps) {
    const beams = now.world.laser.beams;
    for (const [name, stride] of [["robot", 3], ["command", 2], ["near", 1], ["ranges", beams], ["pedestrians", 3 * run.n]]) {
      run[name].splice(0, steps * stride);
    }
    run.steps -= steps;
  }

  function frame(told) {
    if (!now.world) return;
    const fresh = !now.run || told.episode !== now.episode || told.step < now.step || now.run.n > told.pedestrians.length;
    if (fresh) { now.episode = told.episode; begin(told); }
    const run = now.run, again = !fresh && told.step === now.step;
    if (told.pedestrians.length > run.n) widen(run, told.pedestrians);
    if (again) drop_last(run); else now.came = performance.now();
    run.robot.push(...told.robot);
    run.command.push(...told.command);
    run.near.push(told.near);
    run.ranges.push(...bytes(told.ranges));
    run.pedestrians.push(...told.pedestrians.flat());
    run.steps += 1;
    run.goals = told.goals.map(([x, y], body) => [0, body, x, y]);
    Object.assign(run, { goal: told.goal, outcome: told.outcome });
    now.step = told.step;
    if (run.steps > 2 * KEEP) drop(run, KEEP);
    Object.assign(document.body.dataset, { step: told.step, episode: told.episode, pedestrians: run.n, outcome: told.outcome || "",
      goal: told.goal.map((value) => value.toFixed(2)).join(" "), obstacles: now.world.site.length - 1 });
  }

  function drop_last(run) {
    const beams = now.world.laser.beams;
    for (const [name, stride] of [["robot", 3], ["command", 2], ["near", 1], ["ranges", beams], ["pedestrians", 3 * run.n]]) {
      run[name].length -= stride;
    }
    run.steps -= 1;
  }

  let quiet = null;
  function refused({ why }) {
    $("refused").textContent = why;
    link();
    clearTimeout(quiet);
    quiet = setTimeout(() => { $("refused").textContent = ""; }, 5000);
  }

  const HEAR = { choices, room, frame, clock, refused };

  function connect() {
    socket = new WebSocket(`ws://${location.host}/live`);
    socket.addEventListener("open", () => { document.body.dataset.connected = "true"; });
    socket.addEventListener("message", (event) => {
      const told = JSON.parse(event.data);
      HEAR[told.kind](told);
    });
    socket.addEventListener("close", () => {
      now.first = true;
      document.body.dataset.connected = "false";
      $("headline").textContent = "not connected: is `cargo xtask play` still running, with fewer than 8 pages open?";
      setTimeout(connect, RETRY);
    });
  }

  // --- Drawing ------------------------------------------------------------------------------------------------------

  function measure() {
    if (!now.world) return;
    view.canvas.style.width = view.canvas.style.height = "0";
    view.width = Parts.widthOf(view, now.world.site);
  }

  // Between two frames bodies move on: what is drawn is one step behind.
  function time() {
    const share = (performance.now() - now.came) / 1000 * now.times / now.world.dt;
    return now.playing ? Math.max(0, now.run.steps - 1 + Math.min(1, share)) : now.run.steps;
  }

  function draw() {
    const { world, run } = now;
    if (world && run && run.steps >= 0) {
      Scene.draw(view.canvas, view.width, world, run, time(), Scene.colour("accent"), now.layers);
      const at = run.steps, far = Math.hypot(run.robot[3 * at] - run.goal[0], run.robot[3 * at + 1] - run.goal[1]);
      const texts = [(now.step * world.dt).toFixed(1) + " s", run.command[2 * at].toFixed(2) + " m/s",
        run.command[2 * at + 1].toFixed(2) + " rad/s", run.near[at].toFixed(2) + " m", far.toFixed(1) + " m"];
      view.values.forEach((value, k) => { value.textContent = texts[k]; });
      view.badge.textContent = run.outcome ? OUTCOMES[run.outcome] : now.playing ? "on its way" : "paused";
      view.badge.style.color = run.outcome ? `var(--${run.outcome})` : "var(--muted)";
      const label = `Room of ${view.title.textContent}, ${view.badge.textContent}. Arrows move a cross, Enter clicks.`;
      if (view.label !== label) view.canvas.setAttribute("aria-label", view.label = label);
      if (cross && document.activeElement === view.canvas) Scene.cross(view.canvas, view.width, world.site, cross);
      document.body.dataset.playing = now.playing;
    }
    requestAnimationFrame(draw);
  }

  // --- What the visitor does ----------------------------------------------------------------------------------------

  const tool = () => document.querySelector("input[name=tool]:checked").value;
  let wanted = null; // The goal that a drag has reached, sent once a picture.

  function point(event) {
    const [x, y] = Scene.locate(view.canvas, view.width, now.world.site, event);
    if (tool() === "goal") {
      if (wanted === null) requestAnimationFrame(() => { ask("goal", wanted); wanted = null; });
      wanted = { x, y };
    } else if (event.type === "pointerdown") {
      ask(tool(), { x, y });
    }
  }

  view.canvas.addEventListener("pointerdown", (event) => {
    if (!now.world) return;
    view.canvas.setPointerCapture(event.pointerId);
    point(event);
  });
  view.canvas.addEventListener("pointermove", (event) => { if (event.buttons && now.world) point(event); });

  // The same without a mouse: a cross that arrows move by half a metre, with Shift by a tenth.
  let cross = null;
  const MOVES = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  view.canvas.tabIndex = 0;
  view.canvas.setAttribute("role", "application");
  view.canvas.addEventListener("keydown", (event) => {
    if (!now.run || !(event.key in MOVES || event.key === "Enter")) return;
    const box = Scene.bounds(now.world.site), by = event.shiftKey ? 0.1 : 0.5;
    cross = cross || [...now.run.goal];
    if (event.key === "Enter") ask(tool(), { x: cross[0], y: cross[1] });
    else {
      const [x, y] = MOVES[event.key];
      cross = [Math.min(box.right, Math.max(box.left, cross[0] + x * by)), Math.min(box.top, Math.max(box.bottom, cross[1] + y * by))];
    }
    Parts.say(`${event.key === "Enter" ? tool() : "cross"} at ${cross.map((value) => value.toFixed(1)).join(", ")}`, false);
    event.preventDefault();
    event.stopPropagation();
  });

  const play = () => ask(now.playing ? "pause" : "play");
  const rate = (by) => {
    const at = Math.min($("rate").options.length - 1, Math.max(0, $("rate").selectedIndex + by));
    ask("speed", { times: Number($("rate").options[at].value) });
  };
  const pick = (k) => () => { document.querySelector(`input[value=${TOOLS[k]}]`).checked = true; };
  $("play").addEventListener("click", play);
  $("step").addEventListener("click", () => ask("step"));
  $("reset").addEventListener("click", () => ask("reset"));
  $("next").addEventListener("click", () => ask("next"));
  $("rate").addEventListener("change", () => rate(0));
  $("policy").addEventListener("change", tokens);
  $("setup").addEventListener("submit", (event) => {
    event.preventDefault();
    const number = (name) => Number($(name).value);
    ask("setup", { crowd: $("crowd").value, pedestrians: number("pedestrians"), policy: number("policy"), token: number("token"),
      seed: number("seed"), episode: 0 });
  });
  const turn = Parts.theme(new URLSearchParams(location.hash.slice(1)).get("theme"), measure);
  Parts.keys({
    " ": play, ArrowRight: () => ask("step"), r: () => ask("reset"), n: () => ask("next"), "+": () => rate(1), "-": () => rate(-1),
    d: turn, c: () => $("share").click(), 1: pick(0), 2: pick(1), 3: pick(2), ...Parts.layers(now.layers, () => {}),
  }, () => now.world);
  addEventListener("resize", measure);
  addEventListener("hashchange", follow);
  Parts.share(link);
  connect();
  requestAnimationFrame(draw);
})();
