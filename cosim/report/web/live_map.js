/* Where the loop is among its stiffness, damping and delay: curves of the greatest delay borne, and the live point. */

class LiveMap {
  /** told: across (n) and beside (m) gains, inverse (m x n) [1/s] of the delays borne; at: the point as it is now. */
  constructor(host, told, { label, unit, wide, high, at }) {
    Object.assign(this, { told, at });
    const count = 160, low = told.across[0], top = wide;
    this.x = Array.from({ length: count + 1 }, (_, k) => low + ((top - low) * k) / count);
    const curves = told.inverse.map((row) => this.x.map((v) => 1 / this.between(row, v)).map((t) => (t > 1.5 * high ? null : t)));
    this.plot = new uPlot({
      width: 300, height: 260, legend: { show: false }, cursor: { show: false },
      scales: { x: { time: false, range: [0, top] }, y: { range: [0, high] } },
      axes: [
        { stroke: ink("soft"), size: 46, label: `${label} [${unit}]`, labelSize: 16 },
        { stroke: ink("soft"), size: 62, label: "delay each way [s]", labelSize: 16 },
      ],
      series: [{}, ...told.beside.map((_, k) => ({ stroke: () => ink(k === this.nearest() ? "blue" : "grey"), width: 2, dash: [told.beside.length > 1 ? [2, 4] : [], [], [10, 5]][k % 3] }))],
      hooks: { draw: [(u) => this.point(u)] },
    }, [this.x, ...curves], host);
    const key = document.createElement("p"), lines = [told.beside.length > 1 ? "dotted" : "drawn through", "drawn through", "dashed"];
    key.textContent = `Greatest constant delay borne, for B = ${told.beside.map((v, k) => `${v.toPrecision(3)} (${lines[k % 3]})`).join(", ")}; blue where B is now, a red dot: the loop.`;
    host.append(key);
    this.words = document.createElement("p");
    this.words.id = "map-says";
    host.append(this.words);
    this.plot.root.setAttribute("role", "img");
    this.plot.root.setAttribute("aria-describedby", "map-says");
    this.plot.root.setAttribute("aria-label", "stability map: greatest constant delay over stiffness, and where the loop is now");
    this.update();
  }

  /** The inverse of the delay borne at a gain: lines between the places that were computed. */
  between(row, value) {
    const { across } = this.told, last = across.length - 2;
    const k = Math.min(last, Math.max(0, across.findIndex((v) => v >= value) - 1));
    return Math.max(0, row[k] + ((row[k + 1] - row[k]) * (value - across[k])) / (across[k + 1] - across[k]));
  }

  /** The damping of a curve that is nearest to the one that is set. */
  nearest() {
    const { beside } = this.told, { damping } = this.at();
    return beside.reduce((best, v, k) => (Math.abs(Math.log(v / damping)) < Math.abs(Math.log(beside[best] / damping)) ? k : best), 0);
  }

  /** The greatest delay [s] of the nearest curve at the stiffness that is set; Infinity: every delay. */
  borne() {
    return 1 / this.between(this.told.inverse[this.nearest()], this.at().stiffness);
  }

  point(u) {
    const { stiffness, delay, jitter } = this.at(), pen = u.ctx, x = u.valToPos(stiffness, "x", true);
    const [least, most] = [Math.max(0, delay - jitter), delay + jitter].map((v) => u.valToPos(v, "y", true)), y = u.valToPos(delay, "y", true);
    Object.assign(pen, { strokeStyle: ink("red"), fillStyle: ink("red"), lineWidth: 3 * devicePixelRatio });
    pen.beginPath();
    pen.moveTo(x, least);
    pen.lineTo(x, most);
    pen.stroke();
    pen.beginPath();
    pen.arc(x, y, 6 * devicePixelRatio, 0, 7);
    pen.fill();
  }

  /** After a slider: the point, the curve that counts, and both in words. */
  update() {
    const { delay, jitter, damping } = this.at(), borne = this.borne(), level = this.told.beside[this.nearest()];
    const bound = borne > 1e6 ? "every constant delay is borne" : `constant delays up to ${borne.toPrecision(3)} s each way are borne`;
    const inside = delay < borne ? "the loop stands inside" : "the loop stands outside";
    const apart = Math.abs(level - damping) > 1e-9 ? ` (the curve nearest to B = ${damping.toPrecision(3)})` : "";
    this.words.textContent = `At this stiffness and B = ${level.toPrecision(3)}${apart} ${bound}: ${inside}. By the exact spectrum of small motions at the start pose${jitter ? "; the bar is the jitter, for which the map says nothing" : ""}.`;
    this.plot.redraw();
  }
}
