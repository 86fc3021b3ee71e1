// run.js - run the filter over a log in time slices, so that the page responds.
//
// The table has the columns, order and digits of `tselab estimate --out`.

const SLICE = 14; // ms of work between two updates of the page
const MOST_ROWS = 1_000_000; // 2.8 h at 100 Hz: 70 columns of 8 bytes each are 0.5 GB

const DRIVEN = { both: 0, front: 1, rear: 2 }; // the setting driven_axle

// Return the function breathe(what, share). It lets the browser update the page if more
// than SLICE has passed since the last update, and first calls `said(what, share)`.
function makeBreather(said = () => {}) {
  let since = performance.now();
  const channel = new MessageChannel();
  return async (what = "", share = 0) => {
    if (performance.now() - since < SLICE) return;
    said(what, share);
    await new Promise((go) => {
      channel.port1.onmessage = go;
      channel.port2.postMessage(0);
    });
    since = performance.now();
  };
}

const makeLengthError = (name, rows) =>
  new Wrong(
    `${name}: has ${rows} rows; this page reads at most ${MOST_ROWS}. The command tselab has no limit`,
  );

// Set sample_time and max_gap for the log, as `tselab estimate` does; return notes.
function setSampling(desk, sampleTime) {
  if (sampleTime === null) return [];
  const f = desk.lib.field("config", "sample_time"),
    gap = desk.lib.field("config", "max_gap");
  const used = Math.min(Math.max(sampleTime, f.lo), f.hi);
  desk.set("sample_time", used);
  desk.set("max_gap", Math.min(Math.max(gap.def, PAGE.rules.gapInSamples * sampleTime), gap.hi));
  return Math.abs(used - sampleTime) > 1e-6
    ? [
        `rows are ${formatNumber(sampleTime)} s apart; ` +
          `the nearest sample_time that is allowed is ${formatNumber(used)} s`,
      ]
    : [];
}

// Set the filter for a log with one speed for both axles (scripts/tse/car/config.py);
// return notes.
function setWheels(desk, rows) {
  const r = PAGE.rules,
    { wheel_speed_front: front, wheel_speed_rear: rear } = rows.data;
  let low = Infinity,
    high = -Infinity,
    many = 0;
  for (let i = 0; i < rear.length; i++) {
    const ratio = front[i] / rear[i];
    if (!(Math.abs(rear[i]) > r.rolling) || !Number.isFinite(ratio)) continue;
    many++;
    low = Math.min(low, ratio);
    high = Math.max(high, ratio);
  }
  const one = many > r.many && high - low < r.sameRatio;
  desk.set("wheel_signals", one ? 1 : 2);
  return one ? [r.oneSpeed] : [];
}

// Return the number of the group to which a column belongs. Columns that later versions
// of tselab have added are in later groups, and are the last ones in the file
// (scripts/tse/estimation/estimate.py).
function findGeneration(name) {
  if (name.endsWith("_secant")) return 4;
  if (/^(grip|noise_wheel_|innovation_|nis_)/.test(name) || name === "sideslip_sd") return 3;
  if (name === "fault_factor") return 4;
  if (/^(p_|change_|discrepancy_|lag_)/.test(name) || name === "fault_channel" || name === "estimate_age")
    return 2;
  return name.endsWith("_spread_seen") || name.startsWith("noise_") ? 1 : 0;
}

function listColumns(lib) {
  const fields = lib.tables.output
    .map((f, i) => [findGeneration(f.name), i, f.name])
    .sort((a, b) => a[0] - b[0] || a[1] - b[1]);
  const of = (least, most) => fields.filter((f) => f[0] >= least && f[0] <= most).map((f) => f[2]);
  return [
    "time",
    ...of(0, 1),
    ...STIFFNESS.map((s) => `${s}_reason`),
    ...of(2, 3),
    "grip_reason",
    ...of(4, 4),
  ];
}

// Estimates of all rows so far, in the columns of `tselab estimate`. Reasons are codes;
// -1: the row was refused.
class Table {
  constructor(lib, rows, nominal) {
    this.lib = lib;
    this.time = new Float64Array(rows);
    this.rows = 0;
    this.columns = {};
    this.valid = Object.fromEntries(STIFFNESS.map((s) => [s, 0])); // number of valid rows
    this.made = lib.tables.output.map((f) => {
      const stiffness = STIFFNESS.find((s) => f.name === s || f.name.startsWith(`${s}_`));
      const reason = f.name.endsWith("_valid") ? f.name.replace(/valid$/, "reason") : null; // also of grip
      this.columns[f.name] = f.kind === "r" ? new Float64Array(rows) : new Int16Array(rows);
      if (reason) this.columns[reason] = new Int8Array(rows);
      return {
        name: f.name,
        scale: stiffness && f.unit === "1" ? nominal[stiffness] : null,
        reason,
        stiffness,
      };
    });
  }

  // Add the n rows that a desk has estimated; `first`: index of the first of them in
  // `time`.
  take(desk, time, first, n) {
    for (const m of this.made) {
      const column = this.columns[m.name];
      for (let i = 0, k = this.rows; i < n; i++, k++) {
        const value = desk.output(m.name, i);
        if (m.reason) {
          const refused = desk.output("status", i) < 0;
          this.columns[m.reason][k] = refused ? -1 : value;
          column[k] = value === 0 && !refused ? 1 : 0;
          if (m.stiffness) this.valid[m.stiffness] += column[k];
        } else column[k] = m.scale === null ? value : value * m.scale;
      }
    }
    for (let i = 0; i < n; i++) this.time[this.rows + i] = time[first + i];
    this.rows += n;
  }

  reasonText(code) {
    return code < 0
      ? "row refused"
      : (this.lib.tables.reason.find((f) => f.offset === code)?.name ?? "unknown");
  }
}

// Run the filter over checked rows. `seen(table)` is called after each slice.
// `stopped()`: stop and keep the rows so far.
async function estimate(desk, rows, seen, stopped) {
  const nominal = Object.fromEntries(STIFFNESS.map((s) => [s, desk.completed()[NOMINAL[s]]]));
  if (rows.time.length > MOST_ROWS) throw makeLengthError(rows.name, rows.time.length);
  desk.start();
  const table = new Table(desk.lib, rows.time.length, nominal),
    breathe = makeBreather(() => seen(table));
  const data = desk.lib.channels.map((f) => rows.data[f.name]),
    values = new Float64Array(data.length);
  let before = rows.time[0] - (rows.sampleTime || 0.01);
  while (table.rows < rows.time.length && !stopped()) {
    const first = table.rows,
      n = Math.min(desk.rows, rows.time.length - first);
    for (let i = 0; i < n; i++) {
      for (let k = 0; k < data.length; k++) values[k] = data[k][first + i];
      desk.put(i, rows.time[first + i] - before, values);
      before = rows.time[first + i];
    }
    desk.step(n);
    table.take(desk, rows.time, first, n);
    await breathe();
  }
  seen(table);
  return table;
}

// Return the table as CSV, in parts.
async function formatCsv(table, breathe) {
  const names = listColumns(table.lib),
    parts = [`${names.join(",")}\n`];
  const cell = names.map((name) => {
    const column = name === "time" ? table.time : table.columns[name];
    if (name.endsWith("_reason")) return (i) => table.reasonText(column[i]);
    const text = PAGE.double.includes(name) ? formatShortest : formatShortestSingle;
    return column instanceof Float64Array ? (i) => text(column[i]) : (i) => String(column[i]);
  });
  for (let i = 0; i < table.rows; i++) {
    parts.push(`${cell.map((c) => c(i)).join(",")}\n`);
    if (i % 512 === 511) {
      parts.push(parts.splice(-512).join(""));
      await breathe("writing", i / table.rows);
    }
  }
  return parts;
}

// Return the input rows as a log for `tselab estimate`.
function formatLog(rows, lib) {
  const channels = lib.channels.map((f) => f.name),
    truth = Object.keys(rows.truth ?? {});
  const lines = [["time", ...channels, ...truth.map((s) => `ref_${s}`)].join(",")];
  for (let i = 0; i < rows.time.length; i++) {
    lines.push(
      [rows.time[i], ...channels.map((c) => rows.data[c][i]), ...truth.map((s) => rows.truth[s][i])]
        .map(formatShortest)
        .join(","),
    );
  }
  return `${lines.join("\n")}\n`;
}

// Return all settings of the car as a vehicle file. With it and the log above, the
// command gives the same bits. An unknown mass is left out, and the command asks for it.
function formatVehicle(desk, name) {
  const settings = desk.completed();
  const line = (n) => {
    const f = desk.lib.field("config", n),
      about = `${f.unit}, ${f.lo} .. ${f.hi}: ${mayBeUnset(f) ? f.text.replace(/; 0: .*/, "") : f.text}`;
    return n === "mass" && isUnset(f, desk.get(n))
      ? `# mass =  # ${about}; not known`
      : `${n} = ${formatShortest(settings[n])}  # ${about}`;
  };
  const [vehicle, uncertain, sensors] = desk.lib.groups.map((g) => g.map(line).join("\n"));
  const driven = Object.keys(DRIVEN).find((axle) => DRIVEN[axle] === desk.get("driven_axle"));
  return (
    `# Vehicle file for tselab: settings of the page. SI units; stiffness per axle (both wheels).\nname = ` +
    `${JSON.stringify(name)}\ndriven_axle = "${driven}"\n${vehicle}\n\n# Uncertainty of these ` +
    `parameters: sd; 0: known exactly.\n[uncertainty]\n${uncertain}\n\n[sensors]\n${sensors}\n`
  );
}

// Return the rows of the built-in example: a manoeuvre of tselab, simulated, with the
// true stiffness.
function makeExample(desk) {
  const e = PAGE.example,
    n = e.rows,
    { lib } = desk,
    inputs = {
      steer_angle: readDoubles(e.steer_angle),
      wheel_torque_front: readDoubles(e.wheel_torque_front),
    };
  desk.exact();
  for (const [name, value] of Object.entries(e.settings)) desk.set(name, value, "simConfig");
  desk.simStart();
  const time = Float64Array.from({ length: n }, (_, i) => Math.round(i * e.step * 1e9) / 1e9);
  const rows = {
    name: "built-in example",
    time,
    data: {},
    truth: {},
    notes: [],
    sampleTime: computeMedian(computeSteps(time)),
  };
  for (const f of lib.channels) rows.data[f.name] = new Float64Array(n);
  for (const s of STIFFNESS) rows.truth[s] = new Float64Array(n);
  for (let i = 0; i < n; i++) {
    desk.set("dt", i ? time[i] - time[i - 1] : e.step, "simInput");
    for (const [name, values] of Object.entries(inputs)) desk.set(name, values[i], "simInput");
    desk.set("road_level", e.road.findLast(([row]) => row <= i)[1], "simInput");
    desk.simStep();
    for (const f of lib.channels) rows.data[f.name][i] = desk.sim(f.name);
    for (const s of STIFFNESS) rows.truth[s][i] = desk.sim(`true_${s}`) * desk.get(NOMINAL[s]);
  }
  return rows;
}

function readDoubles(text) {
  return new Float64Array(Uint8Array.from(atob(text), (c) => c.charCodeAt(0)).buffer);
}
