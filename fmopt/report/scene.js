"use strict";

// Draws polygons into a depth buffer, then strokes each edge where it is not hidden. Lengths in mm.

function showScene(root) {
  const data = JSON.parse(document.getElementById(root.id + "-data").textContent);
  const canvas = root.querySelector("canvas");
  const pen = canvas.getContext("2d");
  const control = name => root.querySelector('[data-do="' + name + '"]');
  const say = (name, text) => {
    const place = root.querySelector('[data-say="' + name + '"]');
    if (place.textContent !== text) place.textContent = text;
  };
  const state = { way: 0, playing: false, azimuth: 0, elevation: 0, zoom: 0, drag: null, last: 0, dots: [] };
  const STEP = 0.1, SECONDS_A_MOVE = 2.5, FACTOR = 60;

  // ---- small vectors and rotations -------------------------------------------------------------------------------
  const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
  const add = (a, b, s) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]];
  const crossed = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
  const times = (M, v) => [dot(M[0], v), dot(M[1], v), dot(M[2], v)];
  const product = (A, B) => A.map(row => [0, 1, 2].map(j => row[0] * B[0][j] + row[1] * B[1][j] + row[2] * B[2][j]));

  function turned(w) { // Rodrigues
    const angle = Math.hypot(w[0], w[1], w[2]);
    const a = angle < 1e-6 ? 1 : Math.sin(angle) / angle;
    const b = angle < 1e-6 ? 0.5 : (1 - Math.cos(angle)) / (angle * angle);
    const K = [[0, -w[2], w[1]], [w[2], 0, -w[0]], [-w[1], w[0], 0]], KK = product(K, K);
    return [0, 1, 2].map(i => [0, 1, 2].map(j => (i === j ? 1 : 0) + a * K[i][j] + b * KK[i][j]));
  }

  // ---- the way: every move takes the same time, its pieces share it by progress ----------------------------------
  let run, count, whole; // what is shown: the plan, or a trial that does not seat

  function show(name) {
    run = (data.ways || []).find(way => way.name === name) || data;
    count = run.path[run.path.length - 1].move + 1;
    whole = bounds();
    state.way = 0;
    if (control("run")) control("run").value = run.name || "";
  }

  const stepOf = leg => run.steps ? run.steps[leg.move] : leg.move;

  function legAt(way) {
    const move = Math.min(count - 1, Math.floor(way * count));
    const share = way * count - move;
    const legs = run.path.filter(leg => leg.move === move);
    const leg = legs.find(item => share <= item.span[1]) || legs[legs.length - 1];
    const span = leg.span[1] - leg.span[0];
    return { leg, share: span > 0 ? Math.min(1, Math.max(0, (share - leg.span[0]) / span)) : 1 };
  }

  function poseAt(way) {
    const { leg, share } = legAt(way);
    const p = add(leg.p[0], add(leg.p[1], leg.p[0], -1), share);
    return { p, R: product(turned(leg.w.map(value => value * share)), leg.R), leg };
  }

  const placed = (pose, points) => points.map(point => add(times(pose.R, point), pose.p, 1));

  // ---- where a contact is: the vertex, or the point of the moving edge nearest to the fixed one -------------------
  function contactPoint(id, pose) {
    const pair = data.contacts[id];
    if (!pair) return null;
    const moving = placed(pose, pair[0]), fixed = pair[1];
    if (pair[2]) return add(moving[0], pair[2], 1); // of a ball: one radius from its centre
    if (moving.length === 1) return moving[0];
    if (fixed.length === 1) return fixed[0];
    const e = add(moving[1], moving[0], -1), f = add(fixed[1], fixed[0], -1), d = add(fixed[0], moving[0], -1);
    const ee = dot(e, e), ef = dot(e, f), ff = dot(f, f), det = ee * ff - ef * ef;
    const t = det > 1e-9 * ee * ff ? (dot(d, e) * ff - dot(d, f) * ef) / det : 0.5;
    return add(moving[0], e, Math.min(1, Math.max(0, t)));
  }

  // ---- the camera: parallel projection ---------------------------------------------------------------------------
  const corners = data.fixed.lines.flat();
  function bounds() {
    const poses = run.path.map(leg => ({ p: leg.p[0], R: leg.R })).concat([poseAt(1)]);
    const all = corners.concat(...poses.map(pose => placed(pose, data.moving.lines.flat())));
    const low = [0, 1, 2].map(k => Math.min(...all.map(p => p[k]))), high = [0, 1, 2].map(k => Math.max(...all.map(p => p[k])));
    return { centre: [0, 1, 2].map(k => (low[k] + high[k]) / 2), size: Math.hypot(...add(high, low, -1)) };
  }

  function view() {
    const ca = Math.cos(state.azimuth), sa = Math.sin(state.azimuth), ce = Math.cos(state.elevation), se = Math.sin(state.elevation);
    return [[-sa, ca, 0], [-se * ca, -se * sa, ce], [ce * ca, ce * sa, se]]; // right, up, towards the viewer
  }

  function camera(leg) {
    const M = view();
    let centre = whole.centre, size = whole.size;
    if (control("look").value === "rests" && rests(leg).length) {
      const points = rests(leg).map(rest => rest.slice(1)), ranked = (values, share) => values.sort((a, b) => a - b)[Math.floor(share * (values.length - 1))];
      centre = [0, 1, 2].map(k => ranked(points.map(p => p[k]), 0.5));
      size = 4 * Math.max(1e-3, ranked(points.map(p => Math.hypot(...add(p, centre, -1))), 0.8)); // stragglers are outside
    }
    const scale = (data.steps ? 0.88 : 1.02) * canvas.height / size * Math.pow(FACTOR, state.zoom);
    if (control("look").value === "contact" && leg.made.length) {
      const last = run.path.filter(item => item.move === leg.move).pop();
      centre = contactPoint(leg.made[0], poseAt((last.move + 1 - 1e-9) / count)) || centre;
    }
    const o = times(M, centre);
    const see = p => { const q = times(M, p); return [canvas.width / 2 + scale * (q[0] - o[0]), canvas.height / 2 - scale * (q[1] - o[1]), scale * (q[2] - o[2])]; };
    return { see, scale };
  }

  // ---- filling: a polygon is flat, so its depth is linear in the pixel --------------------------------------------
  let picture = null, pixels = null, depth = null;
  const LIGHT = [-0.35, -0.55, 0.76]; // towards the lamp, in the picture's axes

  function clear() {
    if (!picture || picture.width !== canvas.width || picture.height !== canvas.height) {
      picture = pen.createImageData(canvas.width, canvas.height);
      pixels = new Uint32Array(picture.data.buffer);
      depth = new Float32Array(canvas.width * canvas.height);
    }
    pixels.fill(0xffffffff);
    depth.fill(-1e30);
  }

  function fill(points, colour, hatched) {
    const a = points[0];
    let normal = [0, 0, 0];
    for (let k = 1; k + 1 < points.length; k++) normal = add(normal, crossed(add(points[k], a, -1), add(points[k + 1], a, -1)), 1);
    normal = add([0, 0, 0], normal, -1); // the picture's y runs down, which turns loops round
    const length = Math.hypot(...normal);
    if (normal[2] <= 1e-9 * length || length === 0) return;
    const shade = 0.62 + 0.38 * Math.max(0, dot(normal, LIGHT) / length);
    const tone = colour.map(value => Math.min(255, Math.round(value * shade)));
    const ink = (255 << 24) | (tone[2] << 16) | (tone[1] << 8) | tone[0];
    const dark = (255 << 24) | (Math.round(tone[2] * 0.72) << 16) | (Math.round(tone[1] * 0.72) << 8) | Math.round(tone[0] * 0.72);
    const dx = -normal[0] / normal[2], dy = -normal[1] / normal[2], z0 = a[2] - dx * a[0] - dy * a[1];
    const width = canvas.width, ys = points.map(p => p[1]);
    const top = Math.max(0, Math.ceil(Math.min(...ys) - 0.5)), bottom = Math.min(canvas.height - 1, Math.floor(Math.max(...ys) - 0.5));
    for (let row = top; row <= bottom; row++) {
      const y = row + 0.5;
      let left = Infinity, right = -Infinity;
      for (let k = 0; k < points.length; k++) {
        const p = points[k], q = points[(k + 1) % points.length];
        if ((p[1] <= y) === (q[1] <= y)) continue;
        const x = p[0] + (y - p[1]) / (q[1] - p[1]) * (q[0] - p[0]);
        left = Math.min(left, x); right = Math.max(right, x);
      }
      const from = Math.max(0, Math.ceil(left - 0.5)), to = Math.min(width - 1, Math.floor(right - 0.5));
      let z = z0 + dx * (from + 0.5) + dy * y;
      for (let column = from, at = row * width + from; column <= to; column++, at++, z += dx) {
        if (z > depth[at]) { depth[at] = z; pixels[at] = hatched && (column + row) % hatched < 1.5 * hatched / 8 ? dark : ink; }
      }
    }
  }

  // ---- edges: runs of samples that nothing covers are drawn, hidden runs dashed where asked -----------------------
  const HIDDEN_BY = 2.0; // pixels

  function covered(x, y) { // the depth at a pixel or a neighbour: along an edge a steep face may fill the pixel itself
    const w = canvas.width, h = canvas.height;
    if (x < 0 || y < 0 || x >= w || y >= h) return -Infinity;
    const at = y * w + x;
    let least = depth[at];
    if (x > 0) least = Math.min(least, depth[at - 1]);
    if (x + 1 < w) least = Math.min(least, depth[at + 1]);
    if (y > 0) least = Math.min(least, depth[at - w]);
    if (y + 1 < h) least = Math.min(least, depth[at + w]);
    return least;
  }

  function stroke(a, b, style) {
    const steps = Math.max(2, Math.min(4000, Math.ceil(Math.hypot(b[0] - a[0], b[1] - a[1]) / 2)));
    let from = 0, seen = null;
    for (let k = 0; k <= steps + 1; k++) {
      let now = null;
      if (k <= steps) {
        const t = k / steps, x = Math.floor(a[0] + t * (b[0] - a[0])), y = Math.floor(a[1] + t * (b[1] - a[1]));
        now = a[2] + t * (b[2] - a[2]) >= covered(x, y) - HIDDEN_BY * style.scale;
      }
      if (now !== seen) {
        if (seen !== null && (seen || style.hidden)) line(a, b, from / steps, (now === null ? steps : k) / steps, seen, style);
        from = k; seen = now;
      }
    }
  }

  function line(a, b, from, to, seen, style) {
    pen.beginPath();
    pen.setLineDash(seen ? [] : [3 * style.scale, 4 * style.scale]);
    pen.lineWidth = (seen ? style.width : 0.6 * style.width) * style.scale;
    pen.strokeStyle = seen ? style.colour : style.hidden;
    pen.moveTo(a[0] + from * (b[0] - a[0]), a[1] + from * (b[1] - a[1]));
    pen.lineTo(a[0] + to * (b[0] - a[0]), a[1] + to * (b[1] - a[1]));
    pen.stroke();
  }

  function marks(ids, pose, eye) {
    return ids.map(id => [id, contactPoint(id, pose)]).filter(([, at]) => at).map(([id, at]) => [id, eye.see(at)]);
  }

  function mark(at, held, scale) {
    pen.setLineDash([]);
    pen.beginPath();
    pen.arc(at[0], at[1], 5 * scale, 0, 2 * Math.PI);
    pen.lineWidth = 2 * scale;
    pen.fillStyle = held ? "#a34a00" : "#ffffff";
    pen.strokeStyle = held ? "#ffffff" : "#a34a00";
    pen.fill();
    pen.stroke();
  }

  // ---- names of contacts: beside the picture's middle, left ones to the left; those at one place share a line ------
  function callouts(marked, scale) {
    const places = [], LINE = 15 * scale;
    marked.forEach(([id, at]) => {
      const near = places.find(place => Math.hypot(place.at[0] - at[0], place.at[1] - at[1]) < 6 * scale);
      if (near) near.ids.push(id); else places.push({ at, ids: [id] });
    });
    const middle = places.reduce((sum, place) => sum + place.at[0] / places.length, 0);
    pen.font = 12 * scale + "px sans-serif";
    pen.textBaseline = "middle";
    [-1, 1].forEach(side => {
      const column = places.filter(place => (place.at[0] < middle - 1) === (side < 0)).sort((a, b) => a.at[1] - b.at[1]);
      const reach = column.map(place => side * place.at[0]).reduce((a, b) => Math.max(a, b), -Infinity);
      let y = -Infinity;
      const lines = column.map(place => label(place, side, side * (reach + 34 * scale), y = Math.max(place.at[1], y + LINE), scale));
      lines.forEach(draw => draw());
    });
  }

  function label(place, side, x, y, scale) { // the line and a pale ground now, the letters when all grounds are there
    const words = place.ids.join(", "), wide = pen.measureText(words).width, align = side < 0 ? "right" : "left";
    x = Math.min(canvas.width - (side > 0 ? wide : 0) - 6 * scale, Math.max((side < 0 ? wide : 0) + 6 * scale, x));
    pen.setLineDash([]);
    pen.beginPath(); pen.moveTo(place.at[0], place.at[1]); pen.lineTo(x - side * 3 * scale, y);
    pen.lineWidth = scale; pen.strokeStyle = "#a34a00"; pen.stroke();
    pen.textAlign = align; pen.lineJoin = "round";
    pen.lineWidth = 4 * scale; pen.strokeStyle = "#ffffff"; pen.strokeText(words, x, y);
    return () => { pen.textAlign = align; pen.fillStyle = "#7a3700"; pen.fillText(words, x, y); };
  }

  // ---- presses: where one begins, the way of the reference point, twist and wrench, where trials came to rest ------
  const INKS = { wrench: "#a31515", twist: "#00695c", seated: "#1d5c2f", later: "#8a5a00", failed: "#c00000" };

  function arrow(points, ink, words, scale) {
    const [b, c] = points.slice(-2), long = Math.hypot(c[0] - b[0], c[1] - b[1]) || 1, head = 9 * scale;
    const u = [(c[0] - b[0]) / long, (c[1] - b[1]) / long];
    const wing = side => [c[0] - head * (u[0] + 0.4 * side * u[1]), c[1] - head * (u[1] - 0.4 * side * u[0])];
    pen.setLineDash([]);
    [["#ffffff", 5], [ink, 2.2]].forEach(([colour, width]) => {
      pen.lineWidth = width * scale; pen.strokeStyle = colour;
      [points, [wing(-1), c, wing(1)]].forEach(line => {
        pen.beginPath();
        line.forEach(([x, y], k) => k ? pen.lineTo(x, y) : pen.moveTo(x, y));
        pen.stroke();
      });
    });
    if (!words) return;
    pen.font = 13 * scale + "px sans-serif"; pen.textBaseline = "middle"; pen.textAlign = "center"; pen.lineJoin = "round";
    const half = 0.5 * pen.measureText(words).width + 4 * scale, within = (x, low, high) => Math.min(high, Math.max(low, x));
    const x = within(c[0] + u[0] * (half + 6 * scale), half, canvas.width - half);
    const y = within(c[1] + 14 * scale * u[1], 10 * scale, canvas.height - 10 * scale);
    pen.lineWidth = 4 * scale; pen.strokeStyle = "#ffffff"; pen.strokeText(words, x, y);
    pen.fillStyle = ink; pen.fillText(words, x, y);
  }

  function swept(u, at, end) { // about u through a point: the way of the part's end, or a ring around the axis
    const arm = add(end, at, -1), along = dot(arm, u);
    let out = add(arm, u, -along);
    const ring = Math.hypot(...out) < 0.3 * Math.hypot(...arm);
    if (ring) out = crossed(u, Math.abs(u[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0]).map(value => 0.1 * whole.size * value);
    const turn = k => times(turned(u.map(value => value * k * (ring ? 5 : 0.4) / 24)), out);
    return Array.from({ length: 25 }, (_, k) => add(add(at, u, along), turn(k), 1));
  }

  function press(move, pose, eye, scale) {
    const legs = run.path.filter(leg => leg.move === pose.leg.move), way = legs.map(leg => leg.p[0]).concat([legs[legs.length - 1].p[1]]);
    const ghost = { colour: "#808080", width: 0.8, scale, hidden: null }, begun = { p: legs[0].p[0], R: legs[0].R };
    data.moving.lines.forEach(ends => { const [a, b] = placed(begun, ends).map(eye.see); stroke(a, b, ghost); });
    if (control("names").value !== "ids" || control("look").value === "rests") return;
    const seen = way.map(eye.see), gone = Math.hypot(...add(seen[seen.length - 1], seen[0], -1));
    if (gone > 12 * scale) arrow(seen, INKS.twist, "", scale);
    const points = data.moving.lines.flat(), middle = k => (Math.max(...points.map(p => p[k])) + Math.min(...points.map(p => p[k]))) / 2;
    const [at, end] = placed(pose, [move.at, [middle(0), middle(1), Math.max(...points.map(p => p[2]))]]);
    move.arrows.forEach(item => {
      const share = Math.hypot(...item.v), u = item.v.map(value => value / share), from = item.ink === "twist" ? end : at;
      const line = item.turn ? swept(u, at, end) : [from, add(from, u, whole.size * (0.08 + 0.14 * share))];
      arrow(line.map(eye.see), INKS[item.ink], item.words, scale);
    });
  }

  function rests(leg) {
    const which = data.cloud && control("cloud").value;
    return !which || which === "none" ? [] : data.cloud[which === "end" ? data.cloud.length - 1 : stepOf(leg)];
  }

  function cloud(leg, eye, scale) {
    state.dots = rests(leg).map(([trial, ...p]) => ({ trial: data.trials[trial], at: eye.see(p) }));
    pen.setLineDash([]);
    state.dots.forEach(({ trial, at: [x, y] }) => {
      const r = 3 * scale;
      pen.lineWidth = 1.6 * scale; pen.strokeStyle = pen.fillStyle = INKS[trial.end];
      pen.beginPath();
      if (trial.end === "failed") [[-1, -1, 1, 1], [-1, 1, 1, -1]].forEach(([a, b, c, d]) => { pen.moveTo(x + a * r, y + b * r); pen.lineTo(x + c * r, y + d * r); });
      else pen.arc(x, y, trial.end === "later" ? r : 0.8 * r, 0, 2 * Math.PI);
      if (trial.end === "seated") pen.fill(); else pen.stroke();
      if (trial.name === run.name) { pen.beginPath(); pen.arc(x, y, 3 * r, 0, 2 * Math.PI); pen.stroke(); }
    });
  }

  function pick(x, y, reach) { // the trial at a place of the picture, those that can be shown before others
    const far = dot => Math.hypot(dot.at[0] - x, dot.at[1] - y), known = dot => (data.ways.some(way => way.name === dot.trial.name) ? 0 : reach);
    const [near] = state.dots.filter(dot => far(dot) < reach).sort((a, b) => far(a) + known(a) - far(b) - known(b));
    if (!near) return;
    if (known(near) === 0) replay(near.trial.name); else say("held", near.trial.name + ": " + near.trial.words + ".");
  }

  function replay(name) { show(name); play(true); }

  function ruler(scale, eye) {
    const most = 0.2 * canvas.width / eye.scale, ten = Math.pow(10, Math.floor(Math.log10(most))), mm = ten * [5, 2, 1].find(k => k * ten <= most);
    const x = canvas.width - 14 * scale, y = canvas.height - 14 * scale;
    pen.setLineDash([]); pen.lineWidth = 1.4 * scale; pen.beginPath();
    pen.moveTo(x, y); pen.lineTo(x - mm * eye.scale, y); pen.stroke();
    pen.textAlign = "right"; pen.fillText(mm < 0.1 ? Number((1000 * mm).toPrecision(1)) + " µm" : Number(mm.toPrecision(1)) + " mm", x, y - 10 * scale);
  }

  function axes(scale) {
    const M = view(), o = [44 * scale, canvas.height - 40 * scale];
    pen.font = 12 * scale + "px sans-serif";
    pen.fillStyle = pen.strokeStyle = "#111111";
    pen.textAlign = "center"; pen.textBaseline = "middle";
    ["x", "y", "z"].forEach((name, k) => {
      const x = 26 * scale * M[0][k], y = -26 * scale * M[1][k];
      pen.setLineDash([]); pen.lineWidth = 1.4 * scale; pen.beginPath();
      pen.moveTo(o[0], o[1]); pen.lineTo(o[0] + x, o[1] + y); pen.stroke();
      pen.fillText(name, o[0] + 1.35 * x, o[1] + 1.35 * y);
    });
  }

  // ---- a frame ---------------------------------------------------------------------------------------------------
  function draw() {
    const ratio = Math.min(2, window.devicePixelRatio || 1), width = Math.max(200, Math.round(canvas.clientWidth * ratio));
    if (canvas.width !== width) { canvas.width = width; canvas.height = Math.round(width * 10 / 16); }
    const pose = poseAt(state.way), eye = camera(pose.leg), mode = control("fixed").value;
    const fixed = mode === "open" ? data.open : data.fixed;
    clear();
    if (mode !== "lines") fixed.polygons.forEach(loop => fill(loop.map(eye.see), [214, 214, 210], 0));
    if (mode === "open") fixed.caps.forEach(loop => fill(loop.map(eye.see), [236, 222, 200], 8 * ratio));
    if (control("moving").value === "solid" && control("look").value !== "rests") data.moving.polygons.forEach(loop => fill(placed(pose, loop).map(eye.see), [128, 166, 214], 0));
    pen.putImageData(picture, 0, 0);
    const plain = { colour: "#222222", width: 1.1, scale: ratio, hidden: mode === "lines" ? "#999999" : null };
    fixed.lines.forEach(([a, b]) => stroke(eye.see(a), eye.see(b), plain));
    const bold = { colour: "#0b2f5c", width: 1.6, scale: ratio, hidden: "#5f7fa8" };
    data.moving.lines.forEach(ends => { const [a, b] = placed(pose, ends).map(eye.see); stroke(a, b, bold); });
    const made = marks(pose.leg.made, pose, eye), held = marks(pose.leg.held, pose, eye);
    if (control("names").value === "ids") callouts(made.concat(held), ratio);
    made.forEach(([, at]) => mark(at, false, ratio));
    held.forEach(([, at]) => mark(at, true, ratio));
    if (data.moves.length && data.moves[0].arrows) press(data.moves[stepOf(pose.leg)], pose, eye, ratio);
    cloud(pose.leg, eye, ratio);
    axes(ratio);
    ruler(ratio, eye);
    tell(pose.leg, Math.acos(Math.min(1, Math.max(-1, pose.R[2][2]))) * 180 / Math.PI);
  }

  function tell(leg, tilt) {
    const move = data.moves[stepOf(leg)], name = run.name ? run.name[0].toUpperCase() + run.name.slice(1) + " (" + run.words + "), move " : "Move ";
    say("move", move ? name + (leg.move + 1) + " of " + count + ": " + move.words + "." : "Nominal trajectory, leg " + (leg.move + 1) + " of " + count + ".");
    say("held", move ? "Held: " + move.held + (move.margin ? "; " + move.margin : "") + ". Tilted by " + tilt.toFixed(1) + "°." : "");
    control("way").value = Math.round(1000 * state.way);
    control("way").setAttribute("aria-valuetext", "move " + (leg.move + 1) + " of " + count);
    control("play").textContent = state.playing ? "Pause" : "Play";
    root.dataset.way = state.way.toFixed(3);
  }

  // ---- controls --------------------------------------------------------------------------------------------------
  function tick(now) {
    if (!state.playing) return;
    const passed = Math.min(0.1, Math.max(0, (now - state.last) / 1000));
    state.last = now;
    state.way = Math.min(1, state.way + passed / (SECONDS_A_MOVE * count));
    if (state.way >= 1) state.playing = false;
    draw();
    if (state.playing) window.requestAnimationFrame(tick);
  }

  function play(on) {
    state.playing = on;
    if (on && state.way >= 1) state.way = 0;
    state.last = window.performance.now();
    if (on) window.requestAnimationFrame(tick);
    draw();
  }

  function go(way) { state.way = Math.min(1, Math.max(0, way)); state.playing = false; draw(); }
  function jump(by) { go((by > 0 ? Math.floor(state.way * count + 1e-6) + 1 : Math.ceil(state.way * count - 1e-6) - 1) / count); }
  function zoom(by) { state.zoom = Math.min(1, Math.max(0, state.zoom + by)); control("zoom").value = Math.round(100 * state.zoom); draw(); }
  function turn(across, up) {
    state.azimuth += across;
    state.elevation = Math.min(1.55, Math.max(-1.55, state.elevation + up));
    draw();
  }
  function reset() {
    state.azimuth = data.azimuth;
    state.elevation = 0.6;
    state.zoom = 0;
    control("look").value = "whole";
    control("zoom").value = 0;
    draw();
  }

  const KEYS = {
    ArrowLeft: () => turn(-STEP, 0), ArrowRight: () => turn(STEP, 0), ArrowUp: () => turn(0, STEP), ArrowDown: () => turn(0, -STEP),
    "+": () => zoom(0.04), "=": () => zoom(0.04), "-": () => zoom(-0.04), " ": () => play(!state.playing),
    ",": () => go(state.way - 0.2 / count), ".": () => go(state.way + 0.2 / count),
  };
  canvas.addEventListener("keydown", event => {
    if (KEYS[event.key] && !event.ctrlKey && !event.metaKey && !event.altKey) { event.preventDefault(); KEYS[event.key](); }
  });
  canvas.addEventListener("pointerdown", event => { state.drag = state.down = [event.clientX, event.clientY]; canvas.setPointerCapture(event.pointerId); });
  canvas.addEventListener("pointermove", event => {
    if (!state.drag) return;
    turn(-0.008 * (event.clientX - state.drag[0]), 0.008 * (event.clientY - state.drag[1]));
    state.drag = [event.clientX, event.clientY];
  });
  ["pointerup", "pointercancel"].forEach(name => canvas.addEventListener(name, event => {
    const ratio = canvas.width / canvas.clientWidth, still = state.down && Math.hypot(event.clientX - state.down[0], event.clientY - state.down[1]) < 4;
    state.drag = state.down = null;
    if (still && name === "pointerup") pick(event.offsetX * ratio, event.offsetY * ratio, 12 * ratio);
  }));
  canvas.addEventListener("wheel", event => { if (event.ctrlKey || document.activeElement === canvas) { event.preventDefault(); zoom(-0.0004 * event.deltaY); } }, { passive: false });
  control("play").addEventListener("click", () => play(!state.playing));
  control("back").addEventListener("click", () => jump(-1));
  control("on").addEventListener("click", () => jump(1));
  control("way").addEventListener("input", event => go(event.target.value / 1000));
  control("zoom").addEventListener("input", event => { state.zoom = event.target.value / 100; draw(); });
  ["fixed", "moving", "names", "cloud"].filter(control).forEach(name => control(name).addEventListener("change", draw));
  if (control("run")) control("run").addEventListener("change", () => { show(control("run").value); go(0); });
  if (data.ways) document.addEventListener("click", event => { // buttons come later in the page than this script
    const button = event.target.closest("[data-trial]");
    if (!button) return;
    replay(button.dataset.trial);
    canvas.focus({ preventScroll: true });
    root.scrollIntoView({ block: "start" });
  });
  control("look").addEventListener("change", () => { if (control("look").value === "contact" && state.zoom < 0.3) state.zoom = 0.3; zoom(0); });
  control("reset").addEventListener("click", reset);
  window.addEventListener("resize", draw);
  show("");
  reset();
}
