/* Draws what a plot holds: its marks and, for pictures, its frame. The pen is a canvas context or an SvgPen; places are
   { x: value -> pixel, y: value -> pixel, box: { left, top, width, height }, ratio: pixels of the pen a CSS pixel }. */

const SANS = 'system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif';

const colourOf = (name) => getComputedStyle(document.documentElement).getPropertyValue(`--${name}`).trim();

/** The part of a canvas context that is used here, written as SVG. */
class SvgPen {
  constructor() {
    this.parts = [];
    this.way = "";
    this.clips = 0;
    Object.assign(this, { dash: [], lineWidth: 1, strokeStyle: "#000", fillStyle: "#000", globalAlpha: 1 });
  }
  beginPath() { this.way = ""; }
  moveTo(x, y) { this.way += `M${SvgPen.short(x)} ${SvgPen.short(y)}`; }
  lineTo(x, y) { this.way += `L${SvgPen.short(x)} ${SvgPen.short(y)}`; }
  closePath() { this.way += "Z"; }
  arc(x, y, r) { this.way += `M${SvgPen.short(x - r)} ${SvgPen.short(y)}a${r} ${r} 0 1 0 ${2 * r} 0a${r} ${r} 0 1 0 ${-2 * r} 0Z`; }
  rect(x, y, w, h) { this.moveTo(x, y); this.lineTo(x + w, y); this.lineTo(x + w, y + h); this.lineTo(x, y + h); this.closePath(); }
  setLineDash(dash) { this.dash = dash; }
  stroke() {
    const dash = this.dash.length ? ` stroke-dasharray="${this.dash.join(" ")}"` : "";
    this.parts.push(`<path d="${this.way}" fill="none" stroke="${this.strokeStyle}" stroke-width="${this.lineWidth}" stroke-linejoin="round" opacity="${this.globalAlpha}"${dash}/>`);
  }
  fill() { this.parts.push(`<path d="${this.way}" fill="${this.fillStyle}" opacity="${this.globalAlpha}"/>`); }
  drawImage(canvas, x, y, w, h) { this.parts.push(`<image href="${canvas.toDataURL()}" x="${x}" y="${y}" width="${w}" height="${h}"/>`); }
  static short(value) { return String(Math.round(value * 100) / 100); }
  static text(words) { return String(words).replace(/[&<>"]/g, (c) => `&#${c.charCodeAt(0)};`); }
}

/** Text at a place; `angle` -90 for the label of a vertical axis. */
function putText(pen, words, x, y, { align = "left", size = 11, bold = false, angle = 0, colour = "soft" } = {}) {
  if (pen instanceof SvgPen) {
    const anchor = { left: "start", center: "middle", right: "end" }[align];
    const turn = angle ? ` transform="rotate(${angle} ${x} ${y})"` : "";
    pen.parts.push(`<text x="${SvgPen.short(x)}" y="${SvgPen.short(y)}" text-anchor="${anchor}" font-size="${size}"${bold ? ' font-weight="600"' : ""} fill="${colourOf(colour)}"${turn}>${SvgPen.text(words)}</text>`);
    return;
  }
  pen.save();
  pen.translate(x, y);
  pen.rotate((angle * Math.PI) / 180);
  pen.font = `${bold ? "600 " : ""}${size}px ${SANS}`;
  pen.textAlign = align;
  pen.fillStyle = colourOf(colour);
  pen.fillText(words, 0, 0);
  pen.restore();
}

/** Draws inside a box only. */
function clipped(pen, box, draw) {
  if (pen instanceof SvgPen) {
    const id = `clip${Math.random().toString(36).slice(2)}`;
    pen.parts.push(`<clipPath id="${id}"><rect x="${box.left}" y="${box.top}" width="${box.width}" height="${box.height}"/></clipPath><g clip-path="url(#${id})">`);
    draw();
    pen.parts.push("</g>");
    return;
  }
  pen.save();
  pen.beginPath();
  pen.rect(box.left, box.top, box.width, box.height);
  pen.clip();
  draw();
  pen.restore();
}

const polygon = (count, turn, inner = 1) => (pen, x, y, r) => {
  for (let k = 0; k < count; k++) {
    const angle = turn + (2 * Math.PI * k) / count, far = k % 2 ? r * inner : r;
    pen[k ? "lineTo" : "moveTo"](x + far * Math.cos(angle), y + far * Math.sin(angle));
  }
  pen.closePath();
};
const cross = (turn) => (pen, x, y, r) => {
  for (const angle of [turn, turn + Math.PI / 2]) {
    pen.moveTo(x - r * Math.cos(angle), y - r * Math.sin(angle));
    pen.lineTo(x + r * Math.cos(angle), y + r * Math.sin(angle));
  }
};
const SYMBOLS = {
  o: (pen, x, y, r) => { pen.moveTo(x + r, y); pen.arc(x, y, r, 0, 2 * Math.PI); },
  s: polygon(4, Math.PI / 4), D: polygon(4, 0), "^": polygon(3, -Math.PI / 2), v: polygon(3, Math.PI / 2),
  "*": polygon(10, -Math.PI / 2, 0.45), x: cross(Math.PI / 4), X: cross(Math.PI / 4), "+": cross(0), P: cross(0),
};

function drawPoints(pen, series, at) {
  const symbol = SYMBOLS[series.symbol] || SYMBOLS.o, open = "xX+P".includes(series.symbol);
  const r = (series.size / 2) * at.ratio;
  pen.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    const x = at.x(series.x[i]), y = at.y(series.y[i]);
    if (x === x && y === y) symbol(pen, x, y, r);
  }
  pen.strokeStyle = pen.fillStyle = colourOf(series.colour);
  pen.lineWidth = ("XP".includes(series.symbol) ? 2.4 : 1.4) * at.ratio;
  pen[open ? "stroke" : "fill"]();
}

function drawLine(pen, series, at) {
  let down = false;
  pen.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    const x = at.x(series.x[i]), y = at.y(series.y[i]);
    const seen = series.x[i] !== null && series.y[i] !== null && isFinite(x) && isFinite(y);
    if (seen) pen[down ? "lineTo" : "moveTo"](x, y);
    down = seen;
  }
  pen.strokeStyle = colourOf(series.colour);
  pen.lineWidth = series.size * at.ratio;
  pen.setLineDash(series.dash.map((d) => d * at.ratio));
  pen.stroke();
  pen.setLineDash([]);
}

function drawBars(pen, series, at) {
  pen.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    const left = at.x(series.x[i] - series.size / 2), right = at.x(series.x[i] + series.size / 2);
    const base = series.base ? series.base[i] : 0, foot = at.y(base), head = at.y(base + series.y[i]);
    if (isFinite(head)) pen.rect(left, Math.min(foot, head), right - left, Math.abs(head - foot));
  }
  pen.fillStyle = colourOf(series.colour);
  pen.fill();
}

function drawErrors(pen, series, at) {
  const cap = 3 * at.ratio;
  pen.beginPath();
  for (let i = 0; i < series.x.length; i++) {
    if (!(series.error[i] >= 0)) continue;
    const x = at.x(series.x[i]), low = at.y(series.y[i] - series.error[i]), high = at.y(series.y[i] + series.error[i]);
    for (const y of [low, high]) { pen.moveTo(x - cap, y); pen.lineTo(x + cap, y); }
    pen.moveTo(x, low);
    pen.lineTo(x, high);
  }
  pen.strokeStyle = colourOf(series.mark === "bars" ? "ink" : series.colour);
  pen.lineWidth = 1.3 * at.ratio;
  pen.stroke();
}

const DRAW = { line: drawLine, points: drawPoints, bars: drawBars };

function drawSeries(pen, plot, at) {
  for (const series of plot.series) {
    if (series.hidden) continue;
    DRAW[series.mark](pen, series, at);
    if (series.error) drawErrors(pen, series, at);
  }
}

function drawStrips(pen, plot, at) {
  pen.globalAlpha = 0.2;
  pen.fillStyle = colourOf("grey");
  for (const [low, high, upright] of plot.strips) {
    const [a, b] = upright ? [at.x(low), at.x(high)] : [at.y(high), at.y(low)];
    pen.beginPath();
    if (upright) pen.rect(a, at.box.top, b - a, at.box.height);
    else pen.rect(at.box.left, a, at.box.width, b - a);
    pen.fill();
  }
  pen.globalAlpha = 1;
}

function drawGuides(pen, plot, at) {
  for (const [value, colour, dash, upright] of plot.guides) {
    const place = upright ? at.x(value) : at.y(value);
    pen.beginPath();
    if (upright) { pen.moveTo(place, at.box.top); pen.lineTo(place, at.box.top + at.box.height); }
    else { pen.moveTo(at.box.left, place); pen.lineTo(at.box.left + at.box.width, place); }
    pen.strokeStyle = colourOf(colour);
    pen.lineWidth = at.ratio;
    pen.setLineDash(dash.map((d) => d * at.ratio));
    pen.stroke();
    pen.setLineDash([]);
  }
}

/* Viridis (Smith and van der Walt 2015), darkest for the greatest, and Brewer's RdBu: both read by every colour vision. */
const SEQUENTIAL = ["#fde725", "#b5de2b", "#6ece58", "#35b779", "#1f9e89", "#26828e", "#31688e", "#3e4989", "#482878", "#440154"];
const DIVERGING = ["#b2182b", "#d6604d", "#f4a582", "#fddbc7", "#f7f7f7", "#d1e5f0", "#92c5de", "#4393c3", "#2166ac"];
const NO_VALUE = "#f3c9b5";

function heatColour(heat) {
  const table = (heat.diverging ? DIVERGING : SEQUENTIAL).map((c) => [1, 3, 5].map((k) => parseInt(c.slice(k, k + 2), 16)));
  const bend = heat.log ? Math.log : (v) => v, low = bend(heat.limits[0]), high = bend(heat.limits[1]);
  return (value) => {
    if (!isFinite(value) || value === null) return NO_VALUE;
    const place = Math.min(Math.max((bend(value) - low) / (high - low || 1), 0), 1) * (table.length - 1);
    const k = Math.min(Math.floor(place), table.length - 2), part = place - k;
    return `rgb(${table[k].map((c, i) => Math.round(c + part * (table[k + 1][i] - c))).join(",")})`;
  };
}

function drawHeat(pen, heat, at) {
  const [rows, columns] = heat.shape, { box } = at, colour = heatColour(heat);
  const canvas = document.createElement("canvas"), ratio = pen instanceof SvgPen ? 3 : 1;
  canvas.width = box.width * ratio;
  canvas.height = box.height * ratio;
  const inner = canvas.getContext("2d");
  inner.scale(ratio, ratio);
  inner.lineWidth = 0.7;
  for (let i = 0; i + 1 < rows; i++) for (let j = 0; j + 1 < columns; j++) {
    const corners = [i * columns + j, i * columns + j + 1, (i + 1) * columns + j + 1, (i + 1) * columns + j];
    inner.beginPath();
    corners.forEach((c, k) => inner[k ? "lineTo" : "moveTo"](at.x(heat.x[c]) - box.left, at.y(heat.y[c]) - box.top));
    inner.closePath();
    inner.fillStyle = inner.strokeStyle = colour(corners.reduce((sum, c) => sum + (heat.values[c] ?? NaN), 0) / 4);
    inner.fill();
    inner.stroke();
  }
  pen.drawImage(canvas, box.left, box.top, box.width, box.height);
}

/** The whole plot with frame, ticks, labels and legend, as the view `u` (uPlot) shows it: for pictures and print. */
function drawPicture(pen, plot, u, left, top) {
  const width = u.over.clientWidth, height = u.over.clientHeight;
  const box = { left: left + 78, top: top + 20, width, height };
  const at = { box, ratio: 1, x: (v) => box.left + u.valToPos(v, "x"), y: (v) => box.top + u.valToPos(v, "y") };
  let shift = left;
  if (plot.title) putText(pen, plot.title, left, top + 13, { bold: true, colour: "ink", size: 12 });
  shift += plot.title ? plot.title.length * 7 + 16 : 78;
  for (const series of plot.series.filter((s) => s.name && !s.hidden)) {
    pen.beginPath();
    pen.rect(shift, top + 7, 14, 3);
    pen.fillStyle = colourOf(series.colour);
    pen.fill();
    putText(pen, series.name, shift + 18, top + 13);
    shift += series.name.length * 6.2 + 32;
  }
  pen.strokeStyle = colourOf("line");
  pen.lineWidth = 1;
  u.axes.forEach((axis, k) => (axis._splits || []).forEach((value, i) => {
    const place = k ? at.y(value) : at.x(value);
    pen.beginPath();
    if (k) { pen.moveTo(box.left - 4, place); pen.lineTo(box.left + width, place); }
    else { pen.moveTo(place, box.top); pen.lineTo(place, box.top + height + 4); }
    pen.strokeStyle = colourOf("line");
    pen.stroke();
    const words = axis._values?.[i] ?? "";
    if (k) putText(pen, words, box.left - 7, place + 4, { align: "right" });
    else putText(pen, words, place, box.top + height + 17, { align: "center" });
  }));
  putText(pen, plot.x.label, box.left + width / 2, box.top + height + 33, { align: "center" });
  putText(pen, plot.y.label, left + 12, box.top + height / 2, { align: "center", angle: -90 });
  clipped(pen, box, () => {
    drawStrips(pen, plot, at);
    if (plot.heat) drawHeat(pen, plot.heat, at);
    drawGuides(pen, plot, at);
    drawSeries(pen, plot, at);
  });
  return { width: 78 + width + 12, height: 20 + height + 42 };
}
