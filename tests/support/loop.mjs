/* Runs the co-simulation of a live page without a browser: node loop.mjs PAGE LOOP.JS ROWS OUT [CHOICE [SET]]. Writes the rows as doubles, tells
 * what it did. CHOICE: its number in the menu; SET: start values to change first, as JSON. */
import fs from "node:fs";
import vm from "node:vm";
import zlib from "node:zlib";

const [page, script, rows, out, choice = "0", set = "{}"] = process.argv.slice(2);
const text = fs.readFileSync(page, "utf8");
const part = (id) => text.match(new RegExp(`<script type="[^"]*" id="${id}">([^<]*)</script>`))[1];
const scenario = JSON.parse(part("choices"))[choice], bytes = zlib.inflateSync(Buffer.from(part(`module-${choice}`), "base64"));
const Loop = vm.runInThisContext(`${fs.readFileSync(script, "utf8")};Loop`);
const loop = await Loop.open(bytes, scenario), n = scenario.signals.length, table = new Float64Array((Number(rows) + 1) * n), kept = [];
for (const [name, value] of Object.entries(JSON.parse(set))) loop.set(name, value);
loop.reset();
table.set(loop.row);
const began = process.cpuUsage();
let k = 0;
while (k < rows && loop.advance()) {
  table.set(loop.row, ++k * n);
  kept.push(loop.recorded(scenario.arms[0].name));
}
const used = process.cpuUsage(began);
fs.writeFileSync(out, Buffer.from(table.buffer));
const imports = WebAssembly.Module.imports(new WebAssembly.Module(bytes));
console.log(JSON.stringify({ rows: k, ended: loop.ended, imports, signals: scenario.signals, recorded: scenario.recorded,
  recording: loop.recording(kept), factor: loop.time / ((used.user + used.system) / 1e6) }));
