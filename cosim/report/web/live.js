/* The page of a loop to touch: both arms, a hand on the tip of the local one, sliders, readings, a recording. */

const KEPT = 60_000; // rows of the recording
const SEEN = 10; // s of the plots and of the readings
const TURN = 0.7, TILT = 0.3; // rad: from where the arms are seen
const ACROSS = [Math.cos(TURN), 0, Math.sin(TURN)], UP = [Math.sin(TURN) * Math.sin(TILT), Math.cos(TILT), -Math.cos(TURN) * Math.sin(TILT)];
const ENERGIES = { hand: ["energy: the scenario's hand gave", 1], environment: ["energy: the wall gave", 1], coupling: ["energy: the coupling took", -1] };
const dot = (a, b) => a.reduce((sum, v, k) => sum + v * b[k], 0);
const byId = (id) => document.getElementById(id);
const ink = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

class LivePage {
  constructor(loop, scenario) {
    Object.assign(this, { loop, scenario, arms: scenario.arms, running: true, speed: Number(byId("speed").value), place: null, values: new Map() });
    this.canvas = byId("scene");
    this.left = new AbortController();
    this.sliders();
    this.readings();
    this.plots();
    this.chart();
    this.wire();
    this.again();
    let last = performance.now();
    const frame = (now) => {
      if (this.left.signal.aborted) return;
      this.go(Math.min((now - last) / 1000, 0.1) * this.speed);
      last = now;
      this.draw();
      requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }

  /** Make room for another loop. */
  leave() {
    this.left.abort();
    for (const id of ["sliders", "told", "plots", "map"]) byId(id).replaceChildren();
  }

  /* --- time -------------------------------------------------------------------------------------------------------- */

  again() {
    this.loop.reset();
    Object.assign(this, { rows: [], work: 0, free: 0, due: 0, place: null, energy: {}, power: {} });
    if (!this.loop.ended) this.note();
    this.origin = this.arms.map((arm) => this.loop.vector(`${arm.name}.x`));
  }

  /** So many seconds on, or as far as a frame allows. */
  go(seconds) {
    if (!this.running) return;
    this.due = Math.max(this.due, this.loop.time) + seconds;
    const began = performance.now();
    while (this.loop.time < this.due - 1e-9) {
      if (!this.loop.advance()) { this.running = false; break; }
      this.note();
      if (performance.now() - began > 40) { this.due = this.loop.time; break; }
    }
  }

  /** A row for recording, plots and readings. */
  note() {
    const { loop, arms } = this, tips = arms.map((arm) => loop.vector(`${arm.name}.x`));
    const speeds = arms.map((arm) => loop.vector(`${arm.name}.dx`)), before = this.rows[this.rows.length - 1], time = loop.time;
    this.work += before ? dot(loop.felt, speeds[0]) * (time - before.time) : 0;
    if (loop.hand[0]) this.free = time;
    for (const name of Object.keys(this.scenario.ports)) {
      const power = this.powers(name), done = before ? 0.5 * (power + this.power[name]) * (time - before.time) : 0;
      this.energy[name] = (this.energy[name] ?? 0) + done;
      this.power[name] = power;
    }
    this.rows.push({ time, tips, speed: Math.hypot(...speeds.flat()), kept: loop.recorded(arms[0].name) });
    if (this.rows.length > KEPT) this.rows.splice(0, KEPT / 10);
  }

  /** Power [W] that goes into the arms at the ports of a name. */
  powers(name) {
    const { loop } = this, axis = ([signal, gain, shift], v) => (gain * loop.signal(signal) + shift) * loop.signal(v);
    return this.scenario.ports[name].reduce((sum, port) => sum + port.force.reduce((some, f, k) => some + axis(f, port.velocity[k]), 0), 0);
  }

  latest(seconds) {
    const from = this.loop.time - seconds;
    let k = this.rows.length;
    while (k > 0 && this.rows[k - 1].time >= from) k--;
    return this.rows.slice(k);
  }

  /* --- hand -------------------------------------------------------------------------------------------------------- */

  /** Where the hand wants the tip [m]; null lets go. */
  grip(place) {
    this.place = place;
    this.loop.hold(place, this.hand.stiffness, this.hand.damping);
    this.canvas.classList.toggle("held", Boolean(place));
  }

  tip() { return this.loop.vector(`${this.arms[0].name}.x`); }

  /** By so much on the screen [m] from where it is. */
  pull(across, up) {
    const from = this.place ?? this.tip();
    this.grip(from.map((v, k) => v + across * ACROSS[k] + up * UP[k]));
  }

  wire() {
    let at = null;
    const { canvas } = this, until = { signal: this.left.signal };
    canvas.addEventListener("pointerdown", (e) => { at = [e.clientX, e.clientY]; canvas.setPointerCapture(e.pointerId); this.grip(this.tip()); }, until);
    canvas.addEventListener("pointermove", (e) => {
      if (!at) return;
      this.pull((e.clientX - at[0]) / this.scale, -(e.clientY - at[1]) / this.scale);
      at = [e.clientX, e.clientY];
    }, until);
    for (const kind of ["pointerup", "pointercancel"]) canvas.addEventListener(kind, () => { at = null; this.grip(null); }, until);
    canvas.addEventListener("keydown", (e) => {
      const by = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
      if (by) this.pull(...by.map((v) => 0.005 * v));
      else if (e.key === "Escape") this.grip(null);
      else if (e.key === " ") this.toggle();
      else if (e.key === "r" || e.key === "R") this.start();
      else return;
      e.preventDefault();
    }, until);
    byId("pause").onclick = () => this.toggle();
    byId("again").onclick = () => this.start();
    byId("speed").onchange = (e) => { this.speed = Number(e.target.value); };
    byId("csv").onclick = () => save(`${this.scenario.name}-live.csv`, this.loop.recording(this.rows.map((row) => row.kept)));
    byId("toml").onclick = () => save(`${this.scenario.name}-live.toml`, this.scenario.recorded);
  }

  toggle() {
    this.running = !this.running && !this.loop.ended;
  }

  start() {
    this.again();
    this.running = true;
  }

  /* --- what is set and told ---------------------------------------------------------------------------------------- */

  slider({ label, unit, value, least, most }, act) {
    const box = document.createElement("div"), words = document.createElement("label"), told = document.createElement("output"), input = document.createElement("input");
    words.textContent = label;
    words.htmlFor = input.id = told.htmlFor = `slider-${byId("sliders").children.length}`;
    Object.assign(input, { type: "range", min: least, max: most, step: "any", value });
    const name = label.replace(" (starts again)", ""), tell = () => { input.ariaValueText = told.textContent = `${Number(input.value).toPrecision(3)} ${unit}`; };
    const acted = () => { this.values.set(name, Number(input.value)); act(Number(input.value)); this.map?.update(); };
    this.values.set(name, value);
    input.addEventListener("input", tell);
    input.addEventListener("change", acted);
    input.addEventListener("keydown", (e) => {
      const by = { ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 }[e.key];
      if (!by) return;
      e.preventDefault();
      input.value = Number(input.value) + (by * (most - least)) / 100;
      tell();
      acted();
    });
    tell();
    box.append(words, told, input);
    byId("sliders").append(box);
  }

  sliders() {
    this.hand = { ...this.scenario.hand };
    for (const law of this.scenario.laws) {
      const now = { delay: law.delay, jitter: law.jitter }, most = Math.max(1, 4 * law.delay);
      for (const [part, words] of [["delay", "delay"], ["jitter", "jitter, to both sides"]])
        this.slider({ label: `${law.label}: ${words} (starts again)`, unit: "s", value: law[part], least: 0, most }, (value) => {
          now[part] = value;
          this.delayed(law, now);
          this.start();
        });
    }
    for (const s of this.scenario.sliders) {
      this.slider(s.at_once ? s : { ...s, label: `${s.label} (starts again)` }, (value) => {
        const acted = s.names.map((name) => this.loop.set(name, value));
        if (!acted.every(Boolean)) this.start();
      });
    }
    for (const [name, unit] of [["stiffness", "N/m"], ["damping", "N s/m"]]) {
      this.slider({ label: `hand: ${name}`, unit, value: this.hand[name], least: 0, most: 10 * this.hand[name] }, (value) => {
        this.hand[name] = value;
        if (this.place) this.grip(this.place);
      });
    }
  }

  /** A delay that varies to both sides, by the scenario's law or a uniform one; without jitter a constant one. */
  delayed(law, { delay, jitter }) {
    const put = (names, value) => names.forEach((name) => this.loop.set(name, value));
    put(law.law, jitter > 0 && law.own === law.constant ? law.uniform : law.own);
    put(law.mean, delay);
    put(law.least, Math.max(0, delay - jitter));
    put(law.most, delay + jitter);
  }

  readings() {
    this.told = {};
    const names = ["time", "speed of computing", ...(this.arms.length > 1 ? ["tracking, RMS over 10 s"] : []), "growth rate, hand off", "force on the tip", "work on the tip", ...Object.keys(ENERGIES).filter((name) => this.scenario.ports[name]?.length).map((name) => ENERGIES[name][0]), ...this.scenario.delays.map((d) => `delay of ${d}`)];
    for (const name of names) {
      const row = document.createElement("div"), key = document.createElement("dt"), value = document.createElement("dd");
      key.textContent = name;
      row.append(key, value);
      byId("told").append(row);
      this.told[name] = value;
    }
  }

  tell() {
    const { loop } = this, rows = this.latest(SEEN), say = (name, text) => { if (this.told[name]) this.told[name].textContent = text; };
    say("time", `${loop.time.toFixed(2)} s`);
    const now = performance.now();
    if (!this.mark || now - this.mark.now > 1000) {
      if (this.mark) say("speed of computing", `${((loop.time - this.mark.time) / ((now - this.mark.now) / 1000)).toFixed(2)} × real time`);
      this.mark = { now, time: loop.time };
    }
    if (this.arms.length > 1) say("tracking, RMS over 10 s", `${(1e3 * Math.sqrt(mean(rows.map(({ tips: [a, b] }) => dot(a.map((v, k) => v - b[k]), a.map((v, k) => v - b[k])))))).toPrecision(3)} mm`);
    say("growth rate, hand off", growth(rows.filter((row) => row.time > this.free)));
    say("force on the tip", `${Math.hypot(...loop.felt).toPrecision(3)} N`);
    say("work on the tip", `${(1e3 * this.work).toPrecision(3)} mJ`);
    for (const [name, [words, sign]] of Object.entries(ENERGIES)) say(words, `${(1e3 * sign * (this.energy[name] ?? 0)).toPrecision(3)} mJ`);
    for (const d of this.scenario.delays) say(`delay of ${d}`, `${(1e3 * loop.signal(`${d}.delay_now`)).toFixed(1)} ms`);
    byId("pause").textContent = this.running ? "Pause" : "Go on";
    const state = loop.ended ? `Ended: ${loop.ended}. Start again.` : "";
    if (byId("state").textContent !== state) byId("state").textContent = state;
  }

  plots() {
    const names = this.arms.map((arm) => arm.name), colours = ["blue", "orange"];
    this.drawn = [0, 1, 2].map((k) => new uPlot({
      width: 300, height: 130, legend: { show: false }, cursor: { show: false }, scales: { x: { time: false } },
      axes: [{ stroke: ink("soft"), size: 34, label: k === 2 ? "s" : undefined, labelSize: 14 }, { stroke: ink("soft"), size: 62, label: `${"xyz"[k]} [mm]`, labelSize: 16 }],
      series: [{}, ...names.map((name, i) => ({ label: name, stroke: ink(colours[i]), width: 2, dash: i ? [7, 4] : [] }))],
    }, [[], ...names.map(() => [])], byId("plots")));
    const key = document.createElement("p");
    key.textContent = names.map((name, i) => `${name}: ${i ? "orange, dashed" : "blue"}`).join("; ");
    byId("plots").append(key);
  }

  /** The stability map, or why there is none. */
  chart() {
    const { map, no_map: why, coupling, laws: [law] } = this.scenario, of = (words) => this.values.get(`${coupling}: ${words}`);
    byId("map-part").hidden = !map && !why;
    byId("no-map").textContent = why ? `This loop has no map: ${why}.` : "";
    this.map = !map || !law ? null : new LiveMap(byId("map"), map, {
      label: `${coupling}: stiffness K`, unit: this.scenario.sliders.find((s) => s.label === `${coupling}: stiffness K`).unit, wide: map.across[map.across.length - 1], high: Math.max(1, 4 * law.delay),
      at: () => ({ stiffness: of("stiffness K"), damping: of("damping B"), delay: this.values.get(`${law.label}: delay`), jitter: this.values.get(`${law.label}: jitter, to both sides`) }),
    });
  }

  /* --- drawing ----------------------------------------------------------------------------------------------------- */

  draw() {
    const { canvas } = this, ratio = devicePixelRatio, width = canvas.clientWidth, height = canvas.clientHeight;
    if (canvas.width !== Math.round(width * ratio)) Object.assign(canvas, { width: Math.round(width * ratio), height: Math.round(height * ratio) });
    const pen = canvas.getContext("2d"), each = width / this.arms.length;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.clearRect(0, 0, width, height);
    this.scale = (0.9 * Math.min(each, height)) / this.scenario.size;
    this.arms.forEach((arm, k) => this.arm(pen, arm, k, (k + 0.5) * each, height / 2));
    this.tell();
    const rows = this.latest(SEEN), every = Math.max(1, Math.floor(rows.length / 400)), thin = rows.filter((_, k) => k % every === 0);
    const wide = byId("plots").clientWidth;
    if (this.map && this.map.plot.width !== Math.min(wide, 620)) this.map.plot.setSize({ width: Math.min(wide, 620), height: 260 });
    this.drawn.forEach((plot, k) => {
      if (plot.width !== wide) plot.setSize({ width: wide, height: 130 });
      plot.setData([thin.map((row) => row.time), ...this.arms.map((_, i) => thin.map((row) => 1e3 * row.tips[i][k]))]);
    });
  }

  arm(pen, arm, number, left, top) {
    const { origin, scale } = this, c = origin[number], colour = ink(number ? "orange" : "blue");
    const seen = (p) => { const d = p.map((v, k) => v - c[k]); return [left + scale * dot(d, ACROSS), top - scale * dot(d, UP)]; };
    const line = (points, style, wide, dash = []) => {
      pen.beginPath();
      points.forEach((p, k) => pen[k ? "lineTo" : "moveTo"](...seen(p)));
      Object.assign(pen, { strokeStyle: style, lineWidth: wide, lineCap: "round", lineJoin: "round" });
      pen.setLineDash(dash);
      pen.stroke();
      pen.setLineDash([]);
    };
    const tip = this.loop.vector(`${arm.name}.x`);
    line(this.latest(SEEN).filter((_, k) => k % 10 === 0).map((row) => row.tips[number]), colour, 1);
    if (arm.links) for (const stroke of phantom(this.loop.vector(`${arm.name}.q`), arm.links)) line(stroke, ink("ink"), 4);
    if (number && this.rows.length) line([tip, c.map((v, k) => v + this.tip()[k] - origin[0][k])], ink("grey"), 1, [3, 3]);
    if (!number && this.place) line([tip, this.place], ink("red"), 2, [4, 3]);
    pen.beginPath();
    pen.arc(...seen(tip), 7, 0, 7);
    pen.fillStyle = colour;
    pen.fill();
    Object.assign(pen, { fillStyle: ink("ink"), font: "13px system-ui, sans-serif", textAlign: "center" });
    pen.fillText(arm.name, left, 20);
  }
}

/** Strokes of a PHANToM in its base frame [m] (cosim/report/motion.py says the same of a run). */
function phantom([q1, q2, q3], { l1, l2, l3 }) {
  const turned = ([radial, height]) => [Math.sin(q1) * radial, height, Math.cos(q1) * radial - l1];
  const upper = [Math.cos(q2), Math.sin(q2)], fore = [Math.sin(q3), -Math.cos(q3)], along = (p, length, d) => p.map((v, k) => v + length * d[k]);
  const shoulder = [0, l2], elbow = along(shoulder, l1, upper), crank = along(shoulder, l3, fore), rod = along(elbow, l3, fore);
  return [[[0, 0], shoulder], [shoulder, elbow], [elbow, along(elbow, l2, fore)], [shoulder, crank, rod]].map((stroke) => stroke.map(turned));
}

const mean = (values) => values.reduce((sum, v) => sum + v, 0) / Math.max(1, values.length);

/** Least-squares slope of the logarithm of the arms' speed, as root mean squares of half a second. */
function growth(rows) {
  const bins = new Map();
  for (const row of rows) {
    const bin = Math.floor(2 * row.time);
    if (!bins.has(bin)) bins.set(bin, []);
    bins.get(bin).push(row.speed ** 2);
  }
  const points = [...bins].map(([bin, squares]) => [bin / 2, Math.log(Math.sqrt(mean(squares)))]).slice(0, -1).filter(([, y]) => Number.isFinite(y));
  if (points.length < 6) return "after 3 s without hand";
  const x0 = mean(points.map(([x]) => x)), y0 = mean(points.map(([, y]) => y));
  const slope = mean(points.map(([x, y]) => (x - x0) * (y - y0))) / mean(points.map(([x]) => (x - x0) ** 2));
  return `${slope >= 0 ? "+" : ""}${slope.toPrecision(2)} 1/s`;
}

function save(name, text) {
  const link = document.createElement("a");
  link.href = URL.createObjectURL(new Blob([text], { type: "text/plain" }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 1000);
}

async function inflated(text) {
  const bytes = Uint8Array.from(atob(text), (c) => c.charCodeAt(0)), stream = new Blob([bytes]).stream();
  return new Uint8Array(await new Response(stream.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer());
}

/** The loop of a choice in place of the one that runs. */
async function show(number) {
  const told = choices[number];
  try {
    const loop = await Loop.open(await inflated(byId(`module-${number}`).textContent), told);
    window.livePage?.leave();
    window.livePage = new LivePage(loop, told);
    document.documentElement.dataset.ready = String(number);
  } catch (error) {
    byId("state").textContent = `This browser cannot run the page: ${error.message}`;
  }
}

if (matchMedia("(prefers-color-scheme: dark)").matches) document.documentElement.dataset.theme = "dark";
const choices = JSON.parse(byId("choices").textContent), menu = byId("choice");
menu.append(...choices.map(({ label }, k) => new Option(label, k)));
menu.onchange = () => show(Number(menu.value));
byId("choose").hidden = choices.length < 2;
show(0);
