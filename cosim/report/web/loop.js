/* The co-simulation itself: a WebAssembly module of models, master loop and schedule (cosim/exports/module.py). No document is needed. */

class Loop {
  /** scenario: what the page tells of the module (signals, starts, step, every, arms). */
  static async open(bytes, scenario) {
    const { instance } = await WebAssembly.instantiate(bytes, {});
    return new Loop(instance.exports, scenario);
  }

  constructor(module, scenario) {
    Object.assign(this, { module, scenario });
    module._initialize();
    this.place = new Map(scenario.signals.map((name, k) => [name, k]));
    this.reset();
  }

  /** The memory may have grown: views of it are made when they are used. */
  numbers(address, count) { return new Float64Array(this.module.memory.buffer, address, count); }
  get row() { return this.numbers(this.module.row(), this.scenario.signals.length); }
  get time() { return (this.module.done() * this.scenario.step_ns) / 1e9; }
  get hand() { return this.numbers(this.module.hand(), 6); }
  get felt() { return this.numbers(this.module.felt(), 3); }
  get starts() { return this.numbers(this.module.starts(), Object.keys(this.scenario.starts).length); }
  get said() {
    const bytes = new Uint8Array(this.module.memory.buffer, this.module.said(), 512);
    return new TextDecoder().decode(bytes.slice(0, bytes.indexOf(0)));
  }

  /** From t = 0 with the start values as they are. */
  reset() { this.ended = this.module.begin() ? this.said || "a component refuses its start values" : ""; }

  /** To the next row that `cosim run` would record; false where the run has ended. */
  advance() {
    if (this.ended) return false;
    const answer = this.module.advance();
    if (answer) this.ended = ["", this.said || "a component failed", "a component ended the run", "a value passed its bound, or an arm left its range"][answer];
    return !answer;
  }

  signal(name) { return this.row[this.place.get(name)]; }
  vector(stem) { return [1, 2, 3].map((k) => this.signal(`${stem}[${k}]`)); }

  /** Hold the tip at a place with a spring and a damper; null lets it go. */
  hold(place, stiffness, damping) { this.hand.set(place ? [1, stiffness, damping, ...place] : [0, 0, 0, 0, 0, 0]); }

  /** A start value, and where it is tunable that of the running component; true where it acts at once. */
  set(name, value) {
    const { place, component, reference } = this.scenario.starts[name];
    this.starts[place] = value;
    return reference !== null && this.module.tune(component, reference, value) < 2;
  }

  /** What a recording of an arm holds of this moment: time, joint angles, motor torques, force on the tip. */
  recorded(arm) { return [this.time, ...this.vector(`${arm}.q`), ...this.vector(`${arm}.tau_motor`), ...this.felt]; }

  /** A recording that `cosim data` and `cosim identify` read. */
  recording(rows) { return ["time,q1,q2,q3,tau1,tau2,tau3,f1,f2,f3", ...rows.map((row) => row.join(","))].join("\n") + "\n"; }
}
