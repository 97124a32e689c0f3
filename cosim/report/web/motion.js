/* The arms in motion: a small orthographic projection on a canvas, a slider of time that is the cursor of the plots over time. */

class Motion {
  constructor(host, motion, arrays) {
    const whole = (part) => (part && part.array !== undefined ? { values: arrays[part.array], shape: part.shape } : part);
    this.time = arrays[motion.time.array];
    this.arms = motion.arms.map((arm) => ({ ...arm, points: whole(arm.points), forces: Object.entries(arm.forces).map(([name, f]) => ({ name, ...whole(f) })) }));
    this.packets = motion.packets.map((p) => ({ ...p, sent: arrays[p.sent.array], delay: arrays[p.delay.array] }));
    this.walls = motion.walls;
    Object.assign(this, { turn: 0.7, tilt: 0.3, now: this.time[0], speed: 1, playing: false });
    this.measure();
    this.controls(host);
    this.wire();
    this.set(this.now);
  }

  /** Middle and size of what is seen, the greatest force. */
  measure() {
    for (const arm of this.arms) {
      const { values } = arm.points;
      arm.low = [0, 1, 2].map((k) => { let v = Infinity; for (let i = k; i < values.length; i += 3) v = Math.min(v, values[i] ?? Infinity); return v; });
      arm.high = [0, 1, 2].map((k) => { let v = -Infinity; for (let i = k; i < values.length; i += 3) v = Math.max(v, values[i] ?? -Infinity); return v; });
      arm.centre = arm.low.map((v, k) => (v + arm.high[k]) / 2);
    }
    this.size = Math.max(...this.arms.map((arm) => Math.hypot(...arm.low.map((v, k) => arm.high[k] - v))), 1e-6);
    this.strongest = 0;
    for (const arm of this.arms) for (const force of arm.forces) for (let i = 0; i < force.shape[0]; i++) this.strongest = Math.max(this.strongest, Math.hypot(...Motion.row(force, i)));
  }

  static row(table, i) { return [0, 1, 2].map((k) => table.values[3 * i + k] ?? 0); }

  controls(host) {
    const bar = element("div", "tools");
    this.canvas = element("canvas", "scene");
    this.canvas.tabIndex = 0;
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `${this.arms.map((arm) => arm.name).join(" and ")} in motion. Arrows turn the view, the space bar plays and pauses.`);
    this.play = button("▶", "play", () => this.toggle());
    this.slider = element("input", "time");
    Object.assign(this.slider, { type: "range", min: 0, max: this.time.length - 1, step: 1, value: 0 });
    this.slider.setAttribute("aria-label", "time");
    this.told = element("output", "told");
    const speed = element("select", "tool");
    speed.setAttribute("aria-label", "speed");
    for (const factor of [0.1, 0.25, 0.5, 1, 2, 5, 10]) speed.add(new Option(`${factor} ×`, factor, factor === 1, factor === 1));
    speed.onchange = () => { this.speed = Number(speed.value); };
    bar.append(this.play, this.slider, this.told, speed);
    host.prepend(this.canvas, bar);
  }

  wire() {
    this.slider.addEventListener("input", () => this.set(this.time[Number(this.slider.value)]));
    View.listeners.push((link, x, from) => { if (link === "time" && from !== this) this.set(x, false); });
    let at = null;
    this.canvas.addEventListener("pointerdown", (e) => { at = [e.clientX, e.clientY]; this.canvas.setPointerCapture(e.pointerId); });
    this.canvas.addEventListener("pointerup", () => { at = null; });
    this.canvas.addEventListener("pointermove", (e) => {
      if (!at) return;
      this.orbit((e.clientX - at[0]) / 120, (e.clientY - at[1]) / 120);
      at = [e.clientX, e.clientY];
    });
    this.canvas.addEventListener("keydown", (e) => {
      const by = { ArrowLeft: [-0.1, 0], ArrowRight: [0.1, 0], ArrowUp: [0, 0.1], ArrowDown: [0, -0.1] }[e.key];
      if (by) this.orbit(...by);
      else if (e.key === " ") this.toggle();
      else return;
      e.preventDefault();
    });
    new ResizeObserver(() => this.draw()).observe(this.canvas);
    themed.push(() => this.draw());
  }

  orbit(turn, tilt) {
    this.turn += turn;
    this.tilt = Math.max(-1.5, Math.min(1.5, this.tilt + tilt));
    this.draw();
  }

  toggle() {
    this.playing = !this.playing;
    this.play.textContent = this.playing ? "❚❚" : "▶";
    this.play.setAttribute("aria-label", this.playing ? "pause" : "play");
    if (!this.playing) return;
    if (this.now >= this.time[this.time.length - 1]) this.now = this.time[0];
    let last = performance.now();
    const step = (at) => {
      if (!this.playing) return;
      const next = this.now + (this.speed * (at - last)) / 1000, end = this.time[this.time.length - 1];
      last = at;
      this.set(Math.min(next, end));
      if (next >= end) this.toggle();
      else requestAnimationFrame(step);
    };
    requestAnimationFrame(step);
  }

  /** The frame of a time; the plots' cursors follow. */
  set(time, lead = true) {
    this.now = time;
    let low = 0, high = this.time.length - 1;
    while (low < high) { const middle = (low + high + 1) >> 1; if (this.time[middle] <= time + 1e-9) low = middle; else high = middle - 1; }
    this.frame = low;
    this.slider.value = low;
    this.told.textContent = `${time.toFixed(3)} s`;
    this.slider.setAttribute("aria-valuetext", this.told.textContent);
    this.draw();
    if (lead) View.follow("time", time, this);
  }

  /** Points of an arm [m] between the frames before and after now. */
  pose(arm) {
    const [, count] = arm.points.shape, i = this.frame, j = Math.min(i + 1, this.time.length - 1);
    const part = j > i ? Math.max(0, Math.min(1, (this.now - this.time[i]) / (this.time[j] - this.time[i]))) : 0;
    return Array.from({ length: count }, (_, p) => [0, 1, 2].map((k) => {
      const a = arm.points.values[3 * (i * count + p) + k] ?? NaN, b = arm.points.values[3 * (j * count + p) + k] ?? NaN;
      return a + part * (b - a);
    }));
  }

  /* --- drawing ----------------------------------------------------------------------------------------------------- */

  draw() {
    const { canvas } = this, ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    if (!width) return;
    if (canvas.width !== Math.round(width * ratio)) [canvas.width, canvas.height] = [width * ratio, height * ratio];
    const pen = canvas.getContext("2d");
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    const lane = this.arms.length === 2 ? Math.max(90, width * 0.16) : 0, each = (width - lane) / this.arms.length;
    const scale = (0.82 * Math.min(each, height)) / this.size;
    this.tips = this.arms.map((arm, k) => this.arm(pen, arm, { left: k * (each + lane), middle: k * (each + lane) + each / 2, height, scale, colour: k ? "orange" : "blue" }));
    this.packets.forEach((p, k) => this.lane(pen, p, { left: each, right: each + lane, y: height * (0.35 + 0.3 * k) }));
  }

  /** Turned about the vertical axis (y up for a PHANToM's base frame; z up for a serial arm's), then tilted. */
  seen(arm, place, [x, y, z]) {
    const up = arm.strokes.length > 1 ? [x, y, z] : [y, z, x], c = arm.strokes.length > 1 ? arm.centre : [arm.centre[1], arm.centre[2], arm.centre[0]];
    const [a, b, d] = up.map((v, k) => v - c[k]);
    const across = a * Math.cos(this.turn) + d * Math.sin(this.turn), depth = d * Math.cos(this.turn) - a * Math.sin(this.turn);
    return [place.middle + place.scale * across, place.height / 2 - place.scale * (b * Math.cos(this.tilt) - depth * Math.sin(this.tilt))];
  }

  path(pen, points, colour, width) {
    pen.beginPath();
    points.forEach(([x, y], k) => pen[k ? "lineTo" : "moveTo"](x, y));
    Object.assign(pen, { strokeStyle: colourOf(colour), lineWidth: width, lineCap: "round", lineJoin: "round" });
    pen.stroke();
  }

  arm(pen, arm, place) {
    const project = (p) => this.seen(arm, place, p), pose = this.pose(arm), count = arm.points.shape[1];
    putText(pen, arm.name, place.left + 8, 18, { bold: true, colour: "ink", size: 12 });
    for (const wall of this.walls.filter((w) => w.arm === arm.name)) this.wall(pen, wall, arm, project, pose[count - 1]);
    const trace = [];
    for (let i = 0; i <= this.frame; i++) trace.push(project(Motion.row({ values: arm.points.values }, i * count + count - 1)));
    this.path(pen, trace, place.colour, 1);
    arm.strokes.forEach((stroke, k) => this.path(pen, stroke.map((p) => project(pose[p])), "ink", k < 3 ? 4 : 2));
    for (const p of new Set(arm.strokes.flat())) { pen.beginPath(); pen.arc(...project(pose[p]), p === count - 1 ? 5 : 3, 0, 7); pen.fillStyle = colourOf(p === count - 1 ? place.colour : "soft"); pen.fill(); }
    const tip = project(pose[count - 1]);
    arm.forces.forEach((force, k) => this.arrow(pen, force, pose[count - 1], project, k ? "green" : "red", place.scale, [place.left + 8, 36 + 16 * k]));
    return tip;
  }

  arrow(pen, force, tip, project, colour, scale, label) {
    const f = Motion.row(force, this.frame), size = Math.hypot(...f);
    putText(pen, `${force.name} ${size.toPrecision(3)} N`, label[0], label[1], { colour });
    if (!(size > 1e-3 * this.strongest)) return;
    const length = (70 / scale / this.strongest), [x, y] = project(tip), [u, v] = project(tip.map((c, k) => c + length * f[k]));
    this.path(pen, [[x, y], [u, v]], colour, 2.5);
    const angle = Math.atan2(v - y, u - x);
    if (Math.hypot(u - x, v - y) > 4) this.path(pen, [2.6, -2.6].map((t) => [u + 8 * Math.cos(angle + t), v + 8 * Math.sin(angle + t)]).toSpliced(1, 0, [u, v]), colour, 2.5);
  }

  /** A square of the wall's plane, at the foot of the perpendicular from the tip. */
  wall(pen, wall, arm, project, tip) {
    const n = wall.normal, norm = n.reduce((s, v) => s + v * v, 0), far = (n.reduce((s, v, k) => s + v * tip[k], 0) - wall.offset) / norm;
    const foot = tip.map((v, k) => v - far * n[k]), a = Math.abs(n[0]) < 0.9 * Math.sqrt(norm) ? [1, 0, 0] : [0, 1, 0];
    const cross = (p, q) => [p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]];
    const unit = (v) => v.map((c) => c / Math.hypot(...v)), e1 = unit(cross(n, a)), e2 = unit(cross(n, e1)), h = this.size / 6;
    const corners = [[1, 1], [1, -1], [-1, -1], [-1, 1], [1, 1]].map(([s, t]) => project(foot.map((c, k) => c + h * (s * e1[k] + t * e2[k]))));
    pen.globalAlpha = 0.25;
    pen.beginPath();
    corners.forEach((c, k) => pen[k ? "lineTo" : "moveTo"](...c));
    pen.fillStyle = colourOf("grey");
    pen.fill();
    pen.globalAlpha = 1;
    this.path(pen, corners, "grey", 1);
  }

  /** Samples on their way: sent before now and not yet received. */
  lane(pen, p, { left, right, y }) {
    const there = p.source === this.arms[0].name, place = (share) => (there ? left + share * (right - left) : right - share * (right - left));
    this.path(pen, [[left, y], [right, y]], "line", 2);
    putText(pen, `${p.name} ${there ? "→" : "←"}`, (left + right) / 2, y - 12, { align: "center" });
    let flying = 0;
    pen.beginPath();
    for (let i = 0; i < p.sent.length && p.sent[i] <= this.now; i++) {
      const share = (this.now - p.sent[i]) / p.delay[i];
      if (p.delay[i] === null || !(share >= 0 && share < 1)) continue;
      const x = place(share);
      pen.moveTo(x + 3, y);
      pen.arc(x, y, 3, 0, 7);
      flying++;
    }
    pen.fillStyle = colourOf(there ? "blue" : "orange");
    pen.fill();
    this.flying = { ...this.flying, [p.name]: flying };
  }
}
