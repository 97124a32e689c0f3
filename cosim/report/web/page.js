/* The page: unpacks its numbers, makes the plots, and what stands around them: pictures, tables, theme, print. */

const element = (tag, name = "", words = "") => {
  const made = document.createElement(tag);
  if (name) made.className = name;
  if (words) made.textContent = words;
  return made;
};

function button(words, title, action) {
  const made = element("button", "tool", words);
  made.type = "button";
  made.title = title;
  made.setAttribute("aria-label", title);
  made.onclick = action;
  return made;
}

/** A line, a mark or a bar as the legend shows it. */
function swatch(s) {
  const canvas = element("canvas", "swatch"), draw = () => {
    const pen = canvas.getContext("2d"), at = { ratio: 2, x: (v) => v, y: (v) => v, box: { left: 0, top: 0, width: 36, height: 20 } };
    pen.clearRect(0, 0, 36, 20);
    if (s.mark === "points") drawPoints(pen, { ...s, x: [18], y: [10], size: Math.min(Math.max(s.size, 4), 8) }, at);
    else if (s.mark === "bars") drawBars(pen, { ...s, x: [18], y: [-20], base: [20], size: 36 }, at);
    else drawLine(pen, { ...s, x: [0, 36], y: [10, 10], size: Math.max(s.size, 1.5) }, at);
  };
  [canvas.width, canvas.height] = [36, 20];
  canvas.setAttribute("aria-hidden", "true");
  themed.push(draw);
  draw();
  return canvas;
}

/** The colours of a map with the values at their ends. */
function bar(heat) {
  const made = element("span", "heat-bar"), strip = element("span", "strip");
  const table = heat.diverging ? DIVERGING : SEQUENTIAL;
  strip.style.background = `linear-gradient(to right, ${table.join(",")})`;
  made.append(`${heat.label} ${short(heat.limits[0])} `, strip, ` ${short(heat.limits[1])}`);
  return made;
}

/* --- messages ------------------------------------------------------------------------------------------------------- */

let quiet = null;
function said(words, seen = false) {
  const box = document.getElementById("said");
  box.textContent = words;
  box.classList.toggle("seen", seen);
  clearTimeout(quiet);
  quiet = setTimeout(() => box.classList.remove("seen"), 2500);
}

async function copied(words) {
  try {
    await navigator.clipboard.writeText(words);
  } catch {
    const area = document.body.appendChild(element("textarea", "unseen"));
    area.value = words;
    area.select();
    document.execCommand("copy");
    area.remove();
  }
  said(`copied: ${words}`, true);
}

/* --- numbers -------------------------------------------------------------------------------------------------------- */

async function unpacked(words) {
  const bytes = Uint8Array.from(atob(words), (c) => c.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  const content = new Uint8Array(await new Response(stream).arrayBuffer());
  const length = new DataView(content.buffer).getUint32(0, true);
  const page = JSON.parse(new TextDecoder().decode(content.subarray(4, 4 + length)));
  let at = 4 + length;
  page.arrays = page.arrays.map(([kind, n, first, step]) => {
    const size = kind === "f8" ? 8 : 4, planes = content.subarray(at, at + n * size);
    at += n * size;
    const whole = new Uint8Array(n * size);
    for (let b = 0; b < size; b++) for (let i = 0; i < n; i++) whole[i * size + b] = planes[b * n + i];
    if (kind === "steps") {
      let count = 0;
      return Float64Array.from(new Uint32Array(whole.buffer), (jump) => first + (count += jump) * step);
    }
    const values = new (kind === "f8" ? Float64Array : Float32Array)(whole.buffer);
    return values.every(isFinite) ? values : Array.from(values, (v) => (isFinite(v) ? v : null));
  });
  return page;
}

/** Series and maps with their arrays in place of the numbers of these. */
function joined(page) {
  for (const figure of page.figures) for (const plot of figure.plots) {
    for (const part of [...plot.series, ...(plot.heat ? [plot.heat] : [])]) {
      for (const name of ["x", "y", "error", "base", "values"]) if (typeof part[name] === "number") part[name] = page.arrays[part[name]];
    }
  }
  return page;
}

/* --- figures -------------------------------------------------------------------------------------------------------- */

function build(figure, host, source) {
  const tools = element("div", "tools"), grid = element("div", "grid"), views = [];
  grid.style.setProperty("--columns", figure.columns);
  host.prepend(tools, grid);
  figure.plots.forEach((plot, k) => {
    const below = figure.plots[k + figure.columns], last = !below || below.x.label !== plot.x.label || !plot.link;
    views.push(new View(grid.appendChild(element("div", "plot")), plot, last));
  });
  const each = (act) => () => (views[0]?.plot.link && views.every((v) => v.plot.link === views[0].plot.link) ? act(views[0]) : views.forEach(act));
  const held = figure.plots.reduce((a, p) => (p.rows[1] > a[1] ? p.rows : a), [0, 0]);
  if (held[0] < held[1]) tools.appendChild(element("span", "held", `${held[0].toLocaleString("en")} of ${held[1].toLocaleString("en")} rows${source ? `; all are in ${source}` : ""}`));
  tools.append(
    button("−", "zoom out", each((v) => v.zoom(1 / 1.6))), button("+", "zoom in", each((v) => v.zoom(1.6))),
    button("◀", "move left", each((v) => v.shift(-0.25))), button("▶", "move right", each((v) => v.shift(0.25))),
    button("all", "show all", each((v) => v.reset())),
    button("CSV", "the numbers of this figure that the page holds, as CSV", () => saved(`${figure.name}.csv`, "text/csv", table(figure, source))),
    button("SVG", "this figure as a vector picture", () => saved(`${figure.name}.svg`, "image/svg+xml", vector(views).text)),
    button("PNG", "this figure as a picture of points", () => raster(views, `${figure.name}.png`)),
  );
  return views;
}

function saved(name, kind, content) {
  const link = element("a");
  link.href = URL.createObjectURL(content instanceof Blob ? content : new Blob([content], { type: kind }));
  link.download = name;
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
}

/** What the page holds of a figure: one block a plot, one column a series; clouds one below the other. */
function table(figure, source) {
  const cell = (words) => (/[",\n]/.test(words) ? `"${String(words).replace(/"/g, '""')}"` : words);
  const number = (v) => (v === null || v === undefined ? "" : String(Number(v.toPrecision(v === Math.fround(v) ? 7 : 15))));
  const lines = [];
  for (const plot of figure.plots) {
    const [held, of] = plot.rows;
    lines.push(`# ${[plot.title, plot.y.label].filter(Boolean).join(", ")}`);
    lines.push(`# ${held < of ? `the page holds ${held} of ${of} rows, least and greatest values of even stretches among them` : `all ${of} rows`}${source ? `; everything is in ${source}` : ""}`);
    if (plot.shared) {
      lines.push([plot.x.label, ...plot.series.map((s) => s.name || plot.y.label)].map(cell).join(","));
      for (let i = 0; i < held; i++) lines.push([plot.series[0].x[i], ...plot.series.map((s) => s.y[i])].map((v, k) => (k ? number(v) : String(Number(v.toPrecision(12))))).join(","));
    } else {
      lines.push(["series", plot.x.label, plot.y.label, "half interval", "stands on", "note", "command"].map(cell).join(","));
      for (const s of plot.series) for (let i = 0; i < s.x.length; i++) {
        const x = plot.x.names.length && s.x[i] === Math.round(s.x[i]) ? plot.x.names[s.x[i]] : number(s.x[i]);
        lines.push([cell(s.name), cell(x), number(s.y[i]), number(s.error?.[i]), number(s.base?.[i]), cell(s.notes[i] || ""), cell(s.commands[i] || "")].join(","));
      }
      if (plot.heat) plot.heat.values.forEach((v, i) => lines.push([cell(plot.heat.label), number(plot.heat.x[i]), number(plot.heat.y[i]), number(v), "", "", ""].join(",")));
    }
    lines.push("");
  }
  return lines.join("\n");
}

/** All plots of a figure drawn one after the other; each at its place on the page. */
function drawn(pen, views) {
  const area = views[0].host.parentElement.getBoundingClientRect();
  let right = 0, bottom = 0;
  for (const view of views) {
    const place = view.host.getBoundingClientRect(), left = place.left - area.left;
    const size = drawPicture(pen, view.plot, view.u, left, place.top - area.top);
    right = Math.max(right, left + size.width);
    bottom = Math.max(bottom, place.top - area.top + size.height);
  }
  return [Math.ceil(right), Math.ceil(bottom)];
}

function vector(views) {
  const pen = new SvgPen(), [width, height] = drawn(pen, views);
  const text = `<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 ${width} ${height}" width="${width}" height="${height}" font-family="DejaVu Sans, sans-serif"><rect width="100%" height="100%" fill="${colourOf("paper")}"/>${pen.parts.join("")}</svg>`;
  return { text, width, height };
}

function raster(views, name) {
  const canvas = element("canvas"), { width, height } = vector(views);
  [canvas.width, canvas.height] = [3 * width, 3 * height];
  const pen = canvas.getContext("2d");
  pen.scale(3, 3);
  pen.fillStyle = colourOf("paper");
  pen.fillRect(0, 0, width, height);
  drawn(pen, views);
  canvas.toBlob((blob) => saved(name, "image/png", blob));
}

/* --- theme and print ------------------------------------------------------------------------------------------------ */

const themed = [];

function coloured(theme) {
  document.documentElement.dataset.theme = theme;
  for (const view of View.all) view.u.redraw();
  for (const draw of themed) draw();
}

function themes() {
  const dark = matchMedia("(prefers-color-scheme: dark)");
  let chosen = null;
  const wanted = () => chosen || (dark.matches ? "dark" : "light");
  dark.addEventListener("change", () => coloured(wanted()));
  document.getElementById("theme").onclick = () => {
    chosen = wanted() === "dark" ? "light" : "dark";
    coloured(chosen);
  };
  coloured(wanted());
  return wanted;
}

/** Paper is white: figures are put down as vector pictures in light colours, and taken away again. */
function printing(built, wanted) {
  addEventListener("beforeprint", () => {
    coloured("light");
    for (const [host, views] of built) {
      const picture = element("div", "printed"), { text } = vector(views);
      picture.innerHTML = text.replace(/ width="\d+" height="\d+"/, "");
      host.prepend(picture);
    }
  });
  addEventListener("afterprint", () => {
    document.querySelectorAll(".printed").forEach((picture) => picture.remove());
    coloured(wanted());
  });
}

async function start() {
  const began = performance.now();
  const page = joined(await unpacked(document.getElementById("numbers").textContent.trim()));
  const wanted = themes();
  const built = page.figures.map((figure, k) => {
    const host = document.getElementById(`figure-${k + 1}`);
    return [host, build(figure, host, page.source)];
  });
  if (page.motion) window.motion = new Motion(document.getElementById("motion"), page.motion, page.arrays);
  printing(built, wanted);
  document.querySelectorAll("td code").forEach((code) => { code.onclick = () => copied(code.textContent); });
  document.documentElement.dataset.ready = String(Math.round(performance.now() - began));
}

start();
