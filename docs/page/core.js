// core.js - the library in this page: its tables, settings, filters and cars.
//
// Names, ranges, units and offsets of its structs are read from its own tables
// (include/tse/describe.h), as in scripts/tse/library/core.py.

const LAYOUT = [
  "name",
  "kind",
  "offset",
  "def",
  "lo",
  "hi",
  "unit",
  "text",
  "bytes",
  "rows",
  "inputBytes",
  "outputBytes",
  "config",
  "row",
  "out",
  "simConfig",
  "simInput",
  "simOutput",
]; // in the order of page_layout()
const TABLES = {
  config: 0,
  input: 1,
  output: 2,
  simConfig: 3,
  simInput: 4,
  simOutput: 5,
  status: 6,
  reason: 7,
}; // enum tse_struct
const STIFFNESS = ["cx_front", "cy_front", "cy_rear"];
const NOMINAL = {
  cx_front: "longitudinal_stiffness_front",
  cy_front: "cornering_stiffness_front",
  cy_rear: "cornering_stiffness_rear",
};

class Library {
  constructor(instance) {
    this.c = instance.exports;
    this.memory = new DataView(this.c.memory.buffer); // all memory is static, so the buffer stays valid
    this.f64 = new Float64Array(this.c.memory.buffer);
    this.i32 = new Int32Array(this.c.memory.buffer);
    const at = this.c.page_layout();
    this.layout = Object.fromEntries(LAYOUT.map((name, i) => [name, this.int(at + 4 * i)]));
    this.tables = Object.fromEntries(
      Object.entries(TABLES).map(([name, which]) => [name, this.fields(which)]),
    );
    this.groups = [0, 1, 2].map((k) => this.names(this.c.page_group(k))); // vehicle, what may be off, sensors
    // channels of every log; the optional ones after `missing` are not used by the page
    this.channels = this.tables.input.filter(
      (f) => f.name !== "dt" && f.offset < this.field("input", "missing").offset,
    );
    this.version = this.string(this.c.page_version());
    const status = this.c.page_self_test();
    if (status < 0) throw new Error(`${this.statusText(status)}: ${this.string(this.c.page_wrong())}`);
  }

  static async load(bytes) {
    return new Library((await WebAssembly.instantiate(bytes, {})).instance);
  }

  int(at) {
    return this.memory.getInt32(at, true);
  }

  string(at) {
    const bytes = new Uint8Array(this.memory.buffer, at);
    return new TextDecoder().decode(bytes.subarray(0, bytes.indexOf(0)));
  }

  names(at) {
    const out = [];
    for (; this.int(at); at += 4) out.push(this.string(this.int(at)));
    return out;
  }

  fields(which) {
    const l = this.layout,
      out = [];
    const first = this.c.page_fields(which),
      count = this.c.page_count();
    for (let at = first, i = 0; i < count; i++, at += l.bytes) {
      const real = (member) => this.memory.getFloat64(at + l[member], true);
      out.push({
        name: this.string(this.int(at + l.name)),
        kind: String.fromCharCode(this.memory.getUint8(at + l.kind)),
        offset: this.int(at + l.offset),
        def: real("def"),
        lo: real("lo"),
        hi: real("hi"),
        unit: this.string(this.int(at + l.unit)),
        text: this.string(this.int(at + l.text)),
      });
    }
    return out;
  }

  field(table, name) {
    const found = this.tables[table].find((f) => f.name === name);
    if (!found) throw new Error(`the library has no ${name} in its table ${table}`);
    return found;
  }

  statusText(code) {
    return this.tables.status.find((f) => f.offset === code)?.text ?? `status ${code}`;
  }

  desk(k) {
    return new Desk(this, k);
  }
}

// Return whether a setting is not set: its value is a default outside the range.
const isUnset = (f, value) => value === f.def && value < f.lo;
const mayBeUnset = (f) => f.def < f.lo;

function formatRange(f) {
  const unit = f.unit === "" || f.unit === "1" ? "" : ` ${f.unit}`;
  return f.hi >= f.lo ? `${formatNumber(f.lo)} .. ${formatNumber(f.hi)}${unit}` : "any";
}

// Error: the library refuses a setting. `setting`: name of the setting.
class Refused extends Error {
  constructor(text, setting) {
    super(text);
    this.setting = setting;
  }
}

// Settings, a filter and a simulated car, with their own memory.
class Desk {
  constructor(lib, k) {
    this.lib = lib;
    this.base = lib.c.page_desk(k);
    const l = lib.layout;
    this.rows = l.rows;
    this.inputs = lib.channels.map((f) => f.offset >> 3);
    this.dt = lib.field("input", "dt").offset >> 3;
    this.row = (this.base + l.row) >> 3;
    this.out = this.base + l.out;
    this.outputs = lib.tables.output.map((f) => ({
      name: f.name,
      real: f.kind === "r",
      at: f.kind === "r" ? f.offset >> 3 : f.offset >> 2,
    }));
    this.byName = Object.fromEntries(this.outputs.map((o) => [o.name, o]));
    this.places = new Map();
    for (const [table, place] of [
      ["config", l.config],
      ["simConfig", l.simConfig],
      ["simInput", l.simInput],
      ["simOutput", l.simOutput],
    ]) {
      for (const f of lib.tables[table]) {
        this.places.set(`${table}.${f.name}`, {
          at: this.base + place + f.offset,
          integer: "iu".includes(f.kind),
        });
      }
    }
    this.defaults();
  }

  get(name, table = "config") {
    const p = this.places.get(`${table}.${name}`);
    return p.integer ? this.lib.i32[p.at >> 2] : this.lib.f64[p.at >> 3];
  }

  set(name, value, table = "config") {
    const p = this.places.get(`${table}.${name}`);
    if (p.integer) this.lib.i32[p.at >> 2] = value;
    else this.lib.f64[p.at >> 3] = value;
  }

  // Set the settings of an ordinary car (src/tables/uncalibrated.toml) of unknown mass.
  defaults() {
    this.lib.c.page_defaults(this.base);
  }

  // Set the settings of the simulated car, whose parameters are known exactly.
  exact() {
    this.lib.c.page_exact(this.base);
  }

  settings() {
    return Object.fromEntries(this.lib.tables.config.map((f) => [f.name, this.get(f.name)]));
  }

  // Return all settings, with the values that the filter uses for those not set.
  completed() {
    const before = this.settings();
    this.lib.c.page_complete(this.base);
    const made = this.settings();
    for (const [name, value] of Object.entries(before)) this.set(name, value);
    return made;
  }

  check(status) {
    if (status >= 0) return;
    const at = this.lib.c.page_wrong(),
      name = at ? this.lib.string(at) : "";
    for (const table of ["config", "simConfig"]) {
      const f = this.lib.tables[table].find((x) => x.name === name);
      if (f)
        throw new Refused(
          `${name} = ${formatNumber(this.get(name, table))} is refused; allowed: ${formatRange(f)} ` +
            `(${f.text})`,
          name,
        );
    }
    throw new Refused(`settings refused: ${this.lib.statusText(status)}${name ? ` (${name})` : ""}`, name);
  }

  start() {
    this.check(this.lib.c.page_start(this.base));
  }

  // Write input row i: dt, and the channels in the order of tse/input.h. NaN: missing.
  put(i, dt, values) {
    const f64 = this.lib.f64,
      at = this.row + i * (this.lib.layout.inputBytes >> 3);
    f64[at + this.dt] = dt;
    for (let k = 0; k < values.length; k++) f64[at + this.inputs[k]] = values[k];
  }

  // Run rows 0 .. n - 1. The estimates of a refused row are NaN, with the reason as
  // status.
  step(n) {
    const { f64, i32 } = this.lib,
      bytes = this.lib.layout.outputBytes;
    for (let i = 0; i < n; i++) {
      for (const o of this.outputs) {
        if (o.real) f64[((this.out + i * bytes) >> 3) + o.at] = NaN;
        else i32[((this.out + i * bytes) >> 2) + o.at] = 0;
      }
    }
    this.lib.c.page_step(this.base, n);
  }

  // Return one output of row i.
  output(name, i = 0) {
    const o = this.byName[name],
      at = this.out + i * this.lib.layout.outputBytes;
    return o.real ? this.lib.f64[(at >> 3) + o.at] : this.lib.i32[(at >> 2) + o.at];
  }

  simStart() {
    this.check(this.lib.c.page_sim_start(this.base));
  }

  // Simulate one row; it becomes input row 0.
  simStep() {
    const status = this.lib.c.page_sim_step(this.base);
    if (status < 0) throw new Error(`the simulator refused a row: ${this.lib.statusText(status)}`);
  }

  sim(name) {
    return this.get(name, "simOutput");
  }
}

// Return a number as text, rounded.
function formatNumber(x, digits = 4) {
  if (!Number.isFinite(x)) return "–";
  const text =
    Math.abs(x) >= 1e6 || (x !== 0 && Math.abs(x) < 1e-3)
      ? x.toExponential(Math.max(0, digits - 2))
      : String(+x.toPrecision(digits));
  return text
    .replace("-", "−")
    .replace(/\.?0+e/, "e")
    .replace("e+", "e");
}
