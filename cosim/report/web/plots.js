/* One plot on the page: uPlot draws frame and curves over a shared x; clouds, bars and maps are drawn by marks.js. Plots with the
   same link show the same stretch of x, and one cursor reads all of them. */

const GUTTER = 78;
const short = (value) => (value === null || value === undefined || !isFinite(value) ? "–" : String(Number(value.toPrecision(6))));

function ticks(values, step) {
  const most = Math.max(...values.map(Math.abs), 0);
  if (!most) return values.map(String);
  if (most >= 1e6 || most < 1e-3) return values.map((v) => (v ? v.toExponential(Math.max(0, Math.min(4, Math.round(Math.log10(most / step))))) : "0"));
  let digits = 0;
  while (digits < 9 && Math.abs(step * 10 ** digits - Math.round(step * 10 ** digits)) > 1e-6) digits++;
  return values.map((v) => v.toFixed(digits));
}

class View {
  static links = new Map();
  static all = [];
  static busy = false;

  constructor(host, plot, last) {
    Object.assign(this, { host, plot, last, chosen: null, row: -1 });
    this.full = { x: this.extent("x"), y: this.extent("y") };
    this.head = host.appendChild(element("div", "plot-head"));
    this.legend();
    this.holder = host.appendChild(element("div", "plot-frame"));
    this.u = new uPlot(this.options(this.holder.clientWidth), this.data(), this.holder);
    this.tip = this.u.over.appendChild(element("div", "tip"));
    this.ring = this.u.over.appendChild(element("div", "ring"));
    this.tip.hidden = this.ring.hidden = true;
    this.wire();
    View.all.push(this);
    if (plot.link) View.links.set(plot.link, [...(View.links.get(plot.link) || []), this]);
  }

  /* --- what uPlot is told ------------------------------------------------------------------------------------------ */

  options(width) {
    const { plot } = this;
    const inks = { stroke: () => colourOf("soft"), grid: { stroke: () => colourOf("line"), width: 1 }, ticks: { stroke: () => colourOf("line"), width: 1, size: 4 }, font: `11px ${SANS}`, labelFont: `11px ${SANS}`, labelSize: 16 };
    const axis = (key) => ({ ...inks, label: key === "x" && !this.last ? undefined : plot[key].label, ...this.ticking(key) });
    const names = Math.max(0, ...plot.y.names.map((name) => name.length));
    const drag = plot.shared ? { x: true, y: false } : { x: true, y: true, setScale: false };
    return {
      width, height: plot.height + (this.last ? 44 : 28), padding: [6, 12, 0, 0], legend: { show: false },
      scales: { x: { time: false, distr: plot.x.log ? 3 : 1, range: (u, low, high) => [low, high] }, y: this.rising() },
      axes: [{ ...axis("x"), space: 56, size: 26 }, { ...axis("y"), space: 24, size: Math.max(GUTTER - 16, names * 6.4 + 14) }],
      series: [{}, ...(plot.shared ? plot.series.map((s) => this.curve(s)) : [{ show: false }])],
      cursor: { y: !plot.shared, drag: { ...drag, dist: 4 }, points: { size: 6 }, bind: { mousedown: (u, target, next) => (e) => (e.shiftKey ? this.pan(e) : next(e)), dblclick: () => () => this.reset() } },
      hooks: {
        ready: [() => plot.shared || this.reset()],
        drawClear: [() => clipped(this.u.ctx, this.places().box, () => drawStrips(this.u.ctx, plot, this.places()))],
        draw: [() => this.draw()],
        setScale: [(u, key) => key === "x" && this.scaled()],
        setSelect: [() => this.selected()],
        setCursor: [() => this.moved()],
      },
    };
  }

  curve(s) {
    return { label: s.name, stroke: () => colourOf(s.colour), width: s.size, dash: s.dash.length ? s.dash : undefined, points: { show: false }, show: !s.hidden };
  }

  rising() {
    const { y, shared } = this.plot;
    if (!shared) return { auto: false, min: this.full.y[0], max: this.full.y[1], distr: y.log ? 3 : 1, range: (u, low, high) => [low, high] };
    return { distr: y.log ? 3 : 1, range: (u, low, high) => (y.limits ? y.limits : low === null ? [0, 1] : y.log ? [low, high] : uPlot.rangeNum(low, high, 0.08, true)) };
  }

  ticking(key) {
    const { names, log } = this.plot[key];
    if (names.length) return { splits: (u, i, low, high) => names.map((_, k) => k).filter((k) => k >= low && k <= high), values: (u, at) => at.map((k) => names[k]) };
    return { values: (u, at, i, space, step) => (log ? at.map((v) => (v === null ? "" : short(v))) : ticks(at, step)) };
  }

  data() {
    const { plot } = this;
    return plot.shared ? [plot.series[0].x, ...plot.series.map((s) => s.y)] : [this.full.x, [null, null]];
  }

  /** Least and greatest value along an axis, with a margin where clouds would touch the frame. */
  extent(key) {
    const { plot } = this, axis = plot[key];
    if (axis.limits) return axis.limits;
    if (axis.names.length) return [-0.6, axis.names.length - 0.4];
    let low = Infinity, high = -Infinity;
    const see = (value) => { if (value !== null && isFinite(value)) { low = Math.min(low, value); high = Math.max(high, value); } };
    for (const s of plot.series) s[key].forEach((value, i) => {
      const foot = key === "y" && s.mark === "bars" ? (s.base ? s.base[i] : 0) : 0, half = key === "y" && s.error?.[i] > 0 ? s.error[i] : 0;
      see(value + foot - half);
      see(value + foot + half);
      if (key === "y" && s.mark === "bars") see(foot);
    });
    plot.heat?.[key].forEach(see);
    for (const [value, , , upright] of plot.guides) if (upright === (key === "x")) see(value);
    if (low > high) return [0, 1];
    if (plot.shared && key === "x") return [low, high];
    if (axis.log) return [low / 1.1, high * 1.1];
    const pad = 0.05 * (high - low) || Math.abs(high) || 1;
    return [low - pad, high + pad];
  }

  /* --- drawing ----------------------------------------------------------------------------------------------------- */

  places() {
    const { u } = this;
    return { box: u.bbox, ratio: devicePixelRatio, x: (v) => u.valToPos(v, "x", true), y: (v) => u.valToPos(v, "y", true) };
  }

  draw() {
    const at = this.places(), pen = this.u.ctx;
    const { left, top, width, height } = at.box, edge = this.plot.shared ? 0 : 5 * at.ratio;  // marks on the frame are whole
    clipped(pen, { left: left - edge, top: top - edge, width: width + 2 * edge, height: height + 2 * edge }, () => {
      if (this.plot.heat) drawHeat(pen, this.plot.heat, at);
      drawGuides(pen, this.plot, at);
      if (!this.plot.shared) drawSeries(pen, this.plot, at);
    });
  }

  legend() {
    const { head, plot } = this;
    if (plot.title) head.appendChild(element("strong", "", plot.title));
    this.values = plot.series.map((s, k) => {
      if (!s.name) return null;
      const button = head.appendChild(element("button", "key"));
      button.type = "button";
      button.setAttribute("aria-pressed", "true");
      button.title = "show or hide";
      button.appendChild(swatch(s));
      button.append(s.name);
      button.onclick = () => this.toggle(k, button);
      return head.appendChild(element("output", "value"));
    });
    for (const [, colour, dash, , name] of plot.guides.filter((g) => g[4])) {
      const label = head.appendChild(element("span", "key"));
      label.appendChild(swatch({ mark: "line", colour, dash, size: 1 }));
      label.append(name);
    }
    this.where = head.appendChild(element("output", "where"));
    if (plot.heat) head.appendChild(bar(plot.heat));
  }

  toggle(k, button) {
    const s = this.plot.series[k];
    s.hidden = !s.hidden;
    button.setAttribute("aria-pressed", String(!s.hidden));
    if (this.plot.shared) this.u.setSeries(k + 1, { show: !s.hidden });
    else this.u.redraw();
  }

  /* --- zoom and pan ------------------------------------------------------------------------------------------------ */

  get range() {
    const { x, y } = this.u.scales;
    return { x: [x.min, x.max], y: [y.min, y.max] };
  }

  /** Show a stretch of x, and of y where the plot is no time series; linked plots follow in x. */
  show(x, y) {
    const { u, plot } = this;
    if (plot.equal && y) [x, y] = this.equalised(x, y);
    u.batch(() => {
      u.setScale("x", { min: x[0], max: x[1] });
      if (y && !plot.shared) u.setScale("y", { min: y[0], max: y[1] });
    });
  }

  equalised(x, y) {
    const unit = Math.max((x[1] - x[0]) / this.u.over.clientWidth, (y[1] - y[0]) / this.u.over.clientHeight);
    const about = ([low, high], pixels) => [(low + high - unit * pixels) / 2, (low + high + unit * pixels) / 2];
    return [about(x, this.u.over.clientWidth), about(y, this.u.over.clientHeight)];
  }

  /** Magnify about a share of the frame (0.5: its middle). */
  zoom(factor, share = { x: 0.5, y: 0.5 }) {
    const grown = (key) => {
      const log = this.plot[key].log, bend = log ? Math.log : (v) => v, back = log ? Math.exp : (v) => v;
      const [low, high] = this.range[key].map(bend), centre = low + share[key] * (high - low);
      return [centre - (centre - low) / factor, centre + (high - centre) / factor].map(back);
    };
    const { x: all } = this.full, x = grown("x");
    if (this.plot.shared && x[1] - x[0] >= all[1] - all[0]) return this.reset();
    return this.show(x, grown("y"));
  }

  shift(dx, dy = 0) {
    const moved = (key, part) => {
      const log = this.plot[key].log, [low, high] = this.range[key];
      return log ? [low * (high / low) ** part, high * (high / low) ** part] : [low + part * (high - low), high + part * (high - low)];
    };
    this.show(moved("x", dx), moved("y", dy));
  }

  reset() { this.show(this.full.x, this.full.y); }

  pan(down) {
    let from = [down.clientX, down.clientY];
    const move = (e) => {
      this.shift((from[0] - e.clientX) / this.u.over.clientWidth, (e.clientY - from[1]) / this.u.over.clientHeight);
      from = [e.clientX, e.clientY];
    };
    const up = () => { removeEventListener("mousemove", move); removeEventListener("mouseup", up); };
    addEventListener("mousemove", move);
    addEventListener("mouseup", up);
  }

  scaled() {
    if (View.busy || !this.plot.link || !this.u) return;
    View.busy = true;
    const { min, max } = this.u.scales.x;
    for (const other of View.links.get(this.plot.link) || []) if (other !== this) other.show([min, max]);
    queueMicrotask(() => { View.busy = false; });
  }

  selected() {
    const { u, plot } = this, { left, top, width, height } = u.select;
    if (plot.shared || width < 4 || height < 4) return;
    this.show([u.posToVal(left, "x"), u.posToVal(left + width, "x")], [u.posToVal(top + height, "y"), u.posToVal(top, "y")]);
    u.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
  }

  /* --- reading ----------------------------------------------------------------------------------------------------- */

  moved() {
    if (!this.tip) return;
    if (!this.plot.shared) { this.near(); return; }
    const { idx } = this.u.cursor;
    if (idx === this.row) return;
    this.row = idx ?? -1;
    this.tell();
    if (View.reading || idx === null || idx === undefined) return;
    const x = this.plot.series[0].x[idx];
    View.follow(this.plot.link, x, this);
  }

  tell() {
    const known = this.row >= 0, x = known ? this.plot.series[0].x[this.row] : null;
    this.where.textContent = known ? `${this.plot.x.label.replace(/ \[.*/, "")} ${short(x)}` : "";
    this.plot.series.forEach((s, k) => { if (this.values[k]) this.values[k].textContent = known ? short(s.y[this.row]) : ""; });
  }

  /** The cursor of all plots of a link at x; `from` has it already. */
  static follow(link, x, from = null) {
    if (!link || View.reading) return;
    View.reading = true;
    for (const view of View.links.get(link) || []) if (view !== from) view.read(x);
    View.reading = false;
    for (const listener of View.listeners) listener(link, x, from);
  }

  static listeners = [];

  read(x) {
    const { u } = this;
    u.setCursor({ left: u.valToPos(x, "x"), top: u.over.clientHeight / 2 });
  }

  /** The mark nearest to the cursor, at most 24 pixels away: told beside it. */
  near() {
    const { left, top } = this.u.cursor, best = { far: 24 };
    if (left >= 0 && top >= 0) this.plot.series.forEach((s) => {
      if (s.hidden) return;
      for (let i = 0; i < s.x.length; i++) {
        const far = Math.hypot(this.u.valToPos(s.x[i], "x") - left, this.u.valToPos(this.top(s, i), "y") - top) + (s.notes.length ? 0 : 6);
        if (far < best.far) Object.assign(best, { far, s, i });
      }
    });
    this.choose(best.s ? best : left >= 0 && this.plot.heat ? this.place(left, top) : null);
  }

  top(s, i) { return s.y[i] + (s.mark === "bars" && s.base ? s.base[i] : 0); }

  /** The node of a map nearest to the cursor. */
  place(left, top) {
    const { heat } = this.plot, best = { far: Infinity };
    for (let i = 0; i < heat.x.length; i++) {
      const far = Math.hypot(this.u.valToPos(heat.x[i], "x") - left, this.u.valToPos(heat.y[i], "y") - top);
      if (far < best.far) Object.assign(best, { far, i });
    }
    return best.far < 24 ? { s: { name: heat.label, x: heat.x, y: heat.y, notes: [], commands: [], colour: "ink", worth: heat.values }, i: best.i } : null;
  }

  choose(found) {
    this.chosen = found;
    this.tip.hidden = this.ring.hidden = !found;
    if (!found) return;
    const { s, i } = found, { x, y } = this.plot, named = (axis, v) => (axis.names.length ? axis.names[Math.round(v)] : short(v));
    const left = this.u.valToPos(s.x[i], "x"), top = this.u.valToPos(this.top(s, i), "y");
    this.ring.style.transform = `translate(${left - 8}px, ${top - 8}px)`;
    this.tip.replaceChildren(element("strong", "", s.worth ? `${s.name} ${short(s.worth[i])}` : s.name || this.plot.title));
    for (const words of [`${x.label || "x"}: ${named(x, s.x[i])}`, `${y.label || "y"}: ${named(y, s.y[i])}${s.error?.[i] > 0 ? ` ± ${short(s.error[i])}` : ""}`, s.notes[i]]) if (words) this.tip.appendChild(element("div", "", words));
    if (s.commands[i]) this.tip.append(element("code", "", s.commands[i]), element("em", "", "a click, or Enter, copies the command"));
    const wide = this.u.over.clientWidth;
    this.tip.style.left = left > wide / 2 ? "auto" : `${left + 12}px`;
    this.tip.style.right = left > wide / 2 ? `${wide - left + 12}px` : "auto";
    this.tip.style.top = `${Math.max(0, Math.min(top + 8, this.u.over.clientHeight - 60))}px`;
  }

  copy() {
    const command = this.chosen?.s.commands[this.chosen.i];
    if (command) copied(command);
  }

  /* --- keyboard, mouse, size --------------------------------------------------------------------------------------- */

  wire() {
    const { host, u } = this;
    let at = null;
    u.over.addEventListener("mousedown", (e) => { at = [e.clientX, e.clientY]; });
    u.over.addEventListener("click", (e) => { if (!at || Math.hypot(e.clientX - at[0], e.clientY - at[1]) < 4) this.copy(); });
    u.over.addEventListener("wheel", (e) => {
      if (!e.ctrlKey && !e.metaKey) return;
      e.preventDefault();
      const area = u.over.getBoundingClientRect();
      this.zoom(e.deltaY < 0 ? 1.25 : 0.8, { x: (e.clientX - area.left) / area.width, y: 1 - (e.clientY - area.top) / area.height });
    }, { passive: false });
    host.tabIndex = 0;
    host.setAttribute("role", "group");
    host.setAttribute("aria-roledescription", "plot");
    host.setAttribute("aria-label", this.words());
    host.addEventListener("keydown", (e) => this.key(e));
    new ResizeObserver(() => {
      const width = this.holder.clientWidth;
      if (width && Math.abs(width - u.width) > 1) {
        u.setSize({ width, height: u.height });
        if (this.plot.equal) this.reset();
      }
    }).observe(this.holder);
  }

  words() {
    const { plot } = this, names = plot.series.map((s) => s.name).filter(Boolean);
    return `${plot.title || plot.y.label || "plot"}${names.length ? `: ${names.join(", ")}` : ""}; ${plot.y.label} over ${plot.x.label}. Arrows read, plus and minus zoom, shift and arrows move, 0 shows all.`;
  }

  key(e) {
    if (e.target !== this.host || e.ctrlKey || e.altKey || e.metaKey) return;
    const arrow = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] }[e.key];
    if (arrow && e.shiftKey) this.shift(0.15 * arrow[0], 0.15 * arrow[1]);
    else if (arrow && (arrow[0] || !this.plot.shared)) this.step(arrow[0] || arrow[1], e.repeat);
    else if (e.key === "+" || e.key === "=") this.zoom(1.5);
    else if (e.key === "-") this.zoom(1 / 1.5);
    else if (e.key === "0" || e.key === "Home") this.reset();
    else if (e.key === "Enter") this.copy();
    else if (e.key === "Escape") { this.u.setCursor({ left: -10, top: -10 }); this.choose(null); }
    else return;
    e.preventDefault();
  }

  /** The cursor one pixel's worth of rows on, or at the next mark. */
  step(by, fast) {
    if (!this.plot.shared) { this.next(by); return; }
    const { u } = this, { x } = this.plot.series[0], [low, high] = this.range.x;
    let row = this.row < 0 || x[this.row] < low || x[this.row] > high ? u.valToIdx((low + high) / 2) : this.row;
    const seen = u.valToIdx(high) - u.valToIdx(low);
    row = Math.max(0, Math.min(x.length - 1, row + by * (fast ? Math.max(1, Math.round(seen / 100)) : 1)));
    this.read(x[row]);
    said(`${this.where.textContent}: ${this.plot.series.map((s) => `${s.name} ${short(s.y[row])}`).join(", ")}`);
  }

  next(by) {
    const marks = this.plot.series.flatMap((s) => (s.hidden ? [] : Array.from(s.x, (_, i) => ({ s, i }))));
    if (!marks.length) return;
    const telling = marks.filter((m) => m.s.notes.length), among = telling.length ? telling : marks;
    among.sort((a, b) => a.s.x[a.i] - b.s.x[b.i] || a.s.y[a.i] - b.s.y[b.i]);
    const k = this.chosen ? among.findIndex((m) => m.s === this.chosen.s && m.i === this.chosen.i) : -1;
    this.choose(among[(k + by + among.length) % among.length]);
    said(this.tip.innerText);
  }
}
