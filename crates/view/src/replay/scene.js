"use strict";
// Draws one moment of one run on a canvas. It knows rooms, bodies and scans, and nothing of players or pages:
// the replay and the live page both draw with it.
const Scene = (() => {
  const TAU = 2 * Math.PI;
  const TELEPORT = 1.0; // A body that is farther than this (m) from where it was a step ago was put there.
  const MARGIN = 0.35; // Around the walls (m).
  const PAST = 40; // Steps of a pedestrian's trail.
  const FADE = 5; // Steps of it that are equally faint.
  const LEVELS = 24; // Speeds that a robot's trail tells apart.

  // Colours are the style sheet's. They are read once for each theme: at 60 pictures a second and a hundred colours a picture,
  // asking for computed styles takes longer than drawing.
  const colours = new Map();
  let theme = null;
  function colour(name) {
    const { documentElement } = document;
    if (documentElement.dataset.theme !== theme) {
      theme = documentElement.dataset.theme;
      colours.clear();
    }
    if (!colours.has(name)) colours.set(name, getComputedStyle(documentElement).getPropertyValue("--" + name).trim());
    return colours.get(name);
  }

  const mix = (a, b, share) => a + (b - a) * share;

  function mixAngle(a, b, share) {
    const turn = ((b - a) % TAU + 1.5 * TAU) % TAU - TAU / 2;
    return a + turn * share;
  }

  // Between two steps bodies move along the straight line; one that was re-spawned waits for its new place.
  function between(poses, index, share, stride, body) {
    const at = (k) => { const i = (k * stride + body) * 3; return [poses[i], poses[i + 1], poses[i + 2]]; };
    const a = at(index);
    if (share === 0) return a;
    const b = at(index + 1);
    if (Math.hypot(b[0] - a[0], b[1] - a[1]) > TELEPORT) return a;
    return [mix(a[0], b[0], share), mix(a[1], b[1], share), mixAngle(a[2], b[2], share)];
  }

  function bounds(site) {
    const points = site.flat();
    const xs = points.map((p) => p[0]), ys = points.map((p) => p[1]);
    return { left: Math.min(...xs), right: Math.max(...xs), bottom: Math.min(...ys), top: Math.max(...ys) };
  }

  // From world coordinates (metres, y upwards) to those of a canvas of `width` CSS pixels.
  function scales(site, width) {
    const box = bounds(site), scale = width / (box.right - box.left + 2 * MARGIN);
    return {
      scale, height: Math.round((box.top - box.bottom + 2 * MARGIN) * scale),
      x: (x) => (x - box.left + MARGIN) * scale,
      y: (y) => (box.top - y + MARGIN) * scale,
    };
  }

  // A canvas of that width, empty, with a pen for it.
  function pen(canvas, site, width) {
    const { height, ...scaled } = scales(site, width), ratio = window.devicePixelRatio || 1;
    const size = [Math.round(width * ratio), Math.round(height * ratio)];
    // To set a canvas' size is to make a new one, even where it is the same.
    if (canvas.width !== size[0] || canvas.height !== size[1]) [canvas.width, canvas.height] = size;
    canvas.style.width = width + "px";
    canvas.style.height = height + "px";
    const context = canvas.getContext("2d");
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.clearRect(0, 0, width, height);
    return { context, ...scaled };
  }

  function path(p, points) {
    points.forEach(([x, y], k) => p.context[k ? "lineTo" : "moveTo"](p.x(x), p.y(y)));
  }

  function drawSite(p, site) {
    const c = p.context;
    site.forEach((polygon, index) => {
      c.beginPath();
      path(p, polygon);
      c.closePath();
      c.fillStyle = colour(index ? "wall" : "floor");
      c.fill();
    });
    const box = bounds(site);
    c.strokeStyle = colour("line");
    c.lineWidth = 1;
    c.globalAlpha = 0.55;
    c.beginPath();
    for (let x = Math.ceil(box.left / 5) * 5; x <= box.right; x += 5) { c.moveTo(p.x(x), p.y(box.bottom)); c.lineTo(p.x(x), p.y(box.top)); }
    for (let y = Math.ceil(box.bottom / 5) * 5; y <= box.top; y += 5) { c.moveTo(p.x(box.left), p.y(y)); c.lineTo(p.x(box.right), p.y(y)); }
    c.stroke();
    c.globalAlpha = 1;
    c.beginPath();
    path(p, site[0]);
    c.closePath();
    c.strokeStyle = colour("wall");
    c.lineWidth = 2.5;
    c.lineJoin = "round";
    c.stroke();
  }

  // Where the beams of a scan end: `ranges` are bytes of the laser's range, the first beam points `start` from the heading.
  function ends([x, y, heading], laser, ranges) {
    return Array.from(ranges, (byte, k) => {
      const range = byte / 255 * laser.range, angle = heading + laser.start + k * laser.step;
      return [x + range * Math.cos(angle), y + range * Math.sin(angle)];
    });
  }

  function drawLaser(p, world, run, index) {
    const c = p.context, beams = world.laser.beams;
    const robot = between(run.robot, index, 0, 1, 0), [x, y] = robot;
    const points = ends(robot, world.laser, run.ranges.slice(index * beams, (index + 1) * beams));
    const rgb = colour("laser");
    const glow = c.createRadialGradient(p.x(x), p.y(y), 0, p.x(x), p.y(y), world.laser.range * p.scale);
    glow.addColorStop(0, `rgba(${rgb}, 0.26)`);
    glow.addColorStop(1, `rgba(${rgb}, 0.06)`);
    c.beginPath();
    // A sector is closed by way of the robot.
    path(p, world.laser.circle ? points : [[x, y], ...points]);
    c.closePath();
    c.fillStyle = glow;
    c.fill();
    c.strokeStyle = `rgba(${rgb}, 0.22)`;
    c.lineWidth = 1;
    c.stroke();
    c.fillStyle = `rgba(${rgb}, 0.75)`;
    points.forEach(([px, py], k) => {
      if (run.ranges[index * beams + k] < 255) c.fillRect(p.x(px) - 1, p.y(py) - 1, 2, 2);
    });
    c.beginPath();
    c.arc(p.x(x), p.y(y), world.crash_range * p.scale, 0, TAU);
    c.strokeStyle = colour("collision_pedestrian");
    c.globalAlpha = 0.55;
    c.setLineDash([2, 3]);
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  function channels(hex) {
    return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16));
  }

  function drawRobotTrail(p, world, run, time) {
    const c = p.context, slow = channels(colour("slow")), fast = channels(colour("fast"));
    const index = Math.floor(time);
    c.lineWidth = 2.5;
    c.lineCap = c.lineJoin = "round";
    let [x, y] = between(run.robot, 0, 0, 1, 0), shown = null;
    for (let k = 1; k <= Math.ceil(time); k++) {
      const [nx, ny] = k <= index ? between(run.robot, k, 0, 1, 0) : between(run.robot, index, time - index, 1, 0);
      // Steps of about the same speed are one line.
      const level = Math.round(Math.min(1, Math.abs(run.command[2 * k]) / world.v_max) * LEVELS);
      if (level !== shown) {
        if (shown !== null) c.stroke();
        c.strokeStyle = `rgb(${slow.map((s, i) => Math.round(mix(s, fast[i], level / LEVELS))).join(",")})`;
        c.beginPath();
        c.moveTo(p.x(x), p.y(y));
        shown = level;
      }
      c.lineTo(p.x(nx), p.y(ny));
      [x, y] = [nx, ny];
    }
    if (shown !== null) c.stroke();
  }

  function drawTrail(p, run, index, share, body, ink) {
    const c = p.context;
    c.lineWidth = 2;
    c.strokeStyle = ink;
    c.lineCap = "butt";
    c.lineJoin = "round";
    let last = between(run.pedestrians, index, share, run.n, body), open = false;
    for (let k = index; k >= Math.max(0, index - PAST); k--) {
      const here = between(run.pedestrians, k, 0, run.n, body);
      if (Math.hypot(here[0] - last[0], here[1] - last[1]) > TELEPORT) break;
      if ((index - k) % FADE === 0) {
        if (open) c.stroke();
        c.globalAlpha = 0.6 * (1 - (index - k) / PAST);
        c.beginPath();
        c.moveTo(p.x(last[0]), p.y(last[1]));
        open = true;
      }
      c.lineTo(p.x(here[0]), p.y(here[1]));
      last = here;
    }
    if (open) c.stroke();
    c.globalAlpha = 1;
  }

  function drawBody(p, [x, y, heading], size, ink, label, nose) {
    const c = p.context, [length, width] = size.map((s) => s * p.scale);
    c.save();
    c.translate(p.x(x), p.y(y));
    c.rotate(-heading);
    c.beginPath();
    c.roundRect(-length / 2, -width / 2, length, width, Math.min(length, width) * 0.22);
    c.fillStyle = ink;
    c.fill();
    c.lineWidth = 1.5;
    c.strokeStyle = colour("floor");
    c.stroke();
    if (nose) {
      c.beginPath();
      c.moveTo(length / 2 + 1, -width * 0.26);
      c.lineTo(length / 2 + Math.max(5, length * 0.36), 0);
      c.lineTo(length / 2 + 1, width * 0.26);
      c.closePath();
      c.fill();
    }
    c.rotate(heading);
    if (label !== "" && width > 9) {
      c.fillStyle = colour("panel");
      c.font = `700 ${Math.min(13, Math.round(width * 0.72))}px system-ui, sans-serif`;
      c.textAlign = "center";
      c.textBaseline = "middle";
      c.fillText(label, 0, 0.5);
    }
    c.restore();
  }

  function arrow(p, x, y, vx, vy, ink) {
    const c = p.context, ax = p.x(x), ay = p.y(y), bx = p.x(x + vx), by = p.y(y + vy);
    const length = Math.hypot(bx - ax, by - ay);
    if (length < 8) return;
    const ux = (bx - ax) / length, uy = (by - ay) / length;
    c.strokeStyle = c.fillStyle = ink;
    c.lineWidth = 1.5;
    c.beginPath();
    c.moveTo(ax, ay);
    c.lineTo(bx - 4 * ux, by - 4 * uy);
    c.stroke();
    c.beginPath();
    c.moveTo(bx, by);
    c.lineTo(bx - 6 * ux - 3 * uy, by - 6 * uy + 3 * ux);
    c.lineTo(bx - 6 * ux + 3 * uy, by - 6 * uy - 3 * ux);
    c.fill();
  }

  function drawGoal(p, world, [x, y], ink) {
    const c = p.context, radius = world.goal_radius * p.scale;
    c.strokeStyle = c.fillStyle = ink;
    c.globalAlpha = 0.16;
    c.beginPath();
    c.arc(p.x(x), p.y(y), radius, 0, TAU);
    c.fill();
    c.globalAlpha = 1;
    c.lineWidth = 2;
    c.stroke();
    const flag = Math.max(9, radius * 0.95), gx = p.x(x), gy = p.y(y);
    c.beginPath();
    c.moveTo(gx, gy + 1);
    c.lineTo(gx, gy - flag);
    c.stroke();
    c.beginPath();
    c.moveTo(gx, gy - flag);
    c.lineTo(gx + flag * 0.8, gy - flag * 0.72);
    c.lineTo(gx, gy - flag * 0.42);
    c.fill();
  }

  function dashed(p, from, to, ink, alpha) {
    const c = p.context;
    c.strokeStyle = ink;
    c.globalAlpha = alpha;
    c.lineWidth = 1;
    c.setLineDash([4, 5]);
    c.beginPath();
    path(p, [from, to]);
    c.stroke();
    c.setLineDash([]);
    c.globalAlpha = 1;
  }

  // The goal that a pedestrian has at a step: goals are stored when they change.
  function goalOf(run, body, index) {
    let goal = null;
    for (const [step, who, x, y] of run.goals) {
      if (step > index) break;
      if (who === body) goal = [x, y];
    }
    return goal;
  }

  function drawEnd(p, run, time) {
    if (!run.outcome || time < run.steps) return;
    const c = p.context, [x, y] = between(run.robot, run.steps, 0, 1, 0);
    c.strokeStyle = colour(run.outcome);
    c.lineWidth = 3;
    c.beginPath();
    c.arc(p.x(x), p.y(y), 0.85 * p.scale, 0, TAU);
    c.stroke();
    c.globalAlpha = 0.35;
    c.beginPath();
    c.arc(p.x(x), p.y(y), 1.1 * p.scale, 0, TAU);
    c.stroke();
    c.globalAlpha = 1;
  }

  // One moment: `time` in steps, between two of them as well. `ink` is the robot's colour, `layers` says what to show.
  function draw(canvas, width, world, run, time, ink, layers) {
    const p = pen(canvas, world.site, width), crowd = colour(run.crowd);
    const index = Math.min(Math.floor(time), run.steps), share = index < run.steps ? time - index : 0;
    drawSite(p, world.site);
    if (layers.laser) drawLaser(p, world, run, index);
    const robot = between(run.robot, index, share, 1, 0);
    if (layers.goals) {
      for (let body = 0; body < run.n; body++) {
        const goal = goalOf(run, body, index), here = between(run.pedestrians, index, share, run.n, body);
        dashed(p, here, goal, crowd, 0.35);
        p.context.fillStyle = crowd;
        p.context.globalAlpha = 0.55;
        p.context.beginPath();
        p.context.arc(p.x(goal[0]), p.y(goal[1]), 3.5, 0, TAU);
        p.context.fill();
        p.context.globalAlpha = 1;
      }
      dashed(p, robot, run.goal, ink, 0.6);
    }
    drawGoal(p, world, run.goal, ink);
    if (layers.trails) {
      for (let body = 0; body < run.n; body++) drawTrail(p, run, index, share, body, crowd);
      drawRobotTrail(p, world, run, Math.min(time, run.steps));
    }
    const next = Math.min(index + 1, run.steps);
    for (let body = 0; body < run.n; body++) {
      const here = between(run.pedestrians, index, share, run.n, body);
      const [ax, ay] = between(run.pedestrians, Math.max(0, next - 1), 0, run.n, body);
      const [bx, by] = between(run.pedestrians, next, 0, run.n, body);
      const vx = (bx - ax) / world.dt, vy = (by - ay) / world.dt;
      if (layers.speed && Math.hypot(bx - ax, by - ay) < TELEPORT) arrow(p, here[0], here[1], vx * 1.2, vy * 1.2, crowd);
      drawBody(p, here, world.body, crowd, run.token_of_pedestrians === null ? "" : String(run.token_of_pedestrians), run.learned);
    }
    const v = run.command[2 * next];
    if (layers.speed) arrow(p, robot[0], robot[1], v * 1.4 * Math.cos(robot[2]), v * 1.4 * Math.sin(robot[2]), ink);
    drawBody(p, robot, world.body, ink, run.token === null ? "" : String(run.token), true);
    drawEnd(p, run, time);
  }

  // A cross at a place (m), for who has no pointer.
  function cross(canvas, width, site, [x, y]) {
    const p = { context: canvas.getContext("2d"), ...scales(site, width) }, c = p.context, arm = 9;
    for (const [ink, line] of [["panel", 5], ["ink", 2]]) {
      c.strokeStyle = colour(ink);
      c.lineWidth = line;
      c.beginPath();
      c.moveTo(p.x(x) - arm, p.y(y));
      c.lineTo(p.x(x) + arm, p.y(y));
      c.moveTo(p.x(x), p.y(y) - arm);
      c.lineTo(p.x(x), p.y(y) + arm);
      c.stroke();
    }
  }

  // The place (m) that a pointer is at, on a canvas that was drawn with this width.
  function locate(canvas, width, site, event) {
    const box = bounds(site), corner = canvas.getBoundingClientRect(), metres = (box.right - box.left + 2 * MARGIN) / width;
    const x = (event.clientX - corner.left) * metres, y = (event.clientY - corner.top) * metres;
    return [box.left - MARGIN + x, box.top + MARGIN - y];
  }

  return { draw, cross, locate, colour, bounds, ends };
})();
