// map.js - assign the columns of a log to channels and units, and check the rows.
//
// The words and units are those of tselab (scripts/tse/channels/vocabulary.py,
// scripts/tse/log/units.py), which scripts/dev/page.py puts into PAGE. The user can
// correct the guesses. This is a third implementation of scripts/tse/channels (wheels.py,
// scales.py, guesses.py, log.py). It leaves out: sign bits, flags, counters, clocks,
// latencies, resampling, roles by physics and signals.toml.

// Return the spelling of a unit under which PAGE.spelt has it, or null.
function findUnit(text) {
  const plain = text
    .trim()
    .replace(/^[[(\s]+|[\])\s]+$/g, "")
    .replace(/\s+/g, "");
  return [plain, plain.toLowerCase()].find((p) => p in PAGE.spelt) ?? null;
}

// Return the factor from `unit` to SI; null: not convertible. Speeds of wheels need
// `radius`.
function findFactor(unit, si, radius) {
  const plain = findUnit(unit);
  if (plain === null) return null;
  const direct = PAGE.factors[si]?.[plain];
  if (direct !== undefined) return direct;
  const speed = si === "rad/s" && radius ? PAGE.factors["m/s"][plain] : undefined;
  return speed === undefined ? null : speed / radius;
}

function splitWords(name) {
  const text = name.replace(/([a-z0-9])([A-Z])/g, "$1 $2").replace(/([A-Z]+)([A-Z][a-z])/g, "$1 $2");
  return text
    .toLowerCase()
    .split(/[^a-zäöüß0-9]+/)
    .filter(Boolean);
}

// Split a column name such as "Speed [km/h]" or vx_kmh into name and unit ("": none).
function splitUnit(name) {
  const found = /^(.*?)\s*[[({<]\s*([^[\](){}<>]*)\s*[\])}>]\s*$/.exec(name.trim());
  if (found?.[1] && (findUnit(found[2]) !== null || ["", "-", "1"].includes(found[2])))
    return [found[1].trim(), found[2]];
  const words = splitWords(name);
  return [name.trim(), words.length > 1 ? (PAGE.atEnd[words.at(-1)] ?? "") : ""];
}

const patterns = new Map();
function matches(pattern, text) {
  if (!patterns.has(pattern)) patterns.set(pattern, new RegExp(pattern));
  return patterns.get(pattern).test(text);
}

// Return the score of a name for a role, as vocabulary.score_name().
function scoreName(role, name) {
  const text = splitWords(name).join(" "),
    end = splitWords(name.split(/[./]/).at(-1)).join(" ");
  let best = Math.max(0, ...PAGE.roles[role].filter(([p]) => matches(p, end)).map(([, s]) => s));
  if (best < 3)
    best = Math.max(best, ...PAGE.roles[role].filter(([p]) => matches(p, text)).map(([, s]) => s - 0.2));
  return best && matches(`\\b(${PAGE.not[role]})`, end) ? best - 4 : best;
}

// Return wheel or axle of a name, and its score, as vocabulary.find_place().
function findPlace(name) {
  const text = splitWords(name).join(" "),
    end = splitWords(name.split(/[./]/).at(-1)).join(" ");
  if (matches(PAGE.noWheel, end)) return ["", 0];
  const wheel = matches(PAGE.wheel, text),
    worth = wheel ? 3 : 1;
  for (const part of [end, text]) {
    for (const [place, pattern] of Object.entries(PAGE.places)) {
      if (matches(`\\b(${pattern})\\b`, part)) {
        if (place.length > 5 || wheel) return [place, worth];
        continue;
      }
      const before = "(rad|wheel|whl|speed|spd|ws|wss|wsp|n|v|vel|roue|vrad|nrad)_?";
      const joined = `${before}(${pattern})(kmh|rpm|rads|mps|ms)?$`;
      if (place.length > 5 && wheel && matches(joined, part.replaceAll(" ", ""))) return [place, worth - 0.3];
    }
  }
  return ["", 0];
}

// Channels of a mapping: time, then those of the library
const CHANNELS = [
  "time",
  "steer_angle",
  "wheel_speed_front",
  "wheel_speed_rear",
  "accel_x",
  "accel_y",
  "yaw_rate",
];
const NEEDED = ["time", "steer_angle"];
const isAxle = (channel) => channel.startsWith("wheel_speed");

const TIME_NAME =
  "^(time|t|timestamps?|zeit|temps|tiempo|tempo|sec|seconds|elapsed|datum|clock|uhrzeit)" +
  "( (s|ms|us|ns|sec|seconds|stamp|rel|abs|s rel))?$";

// Propose a mapping: channel -> {column, other: right wheel or "", unit, sign, ratio}.
// Columns with the names of the library are used as they are.
function propose(table, lib) {
  const names = table.columns.map((c) => c.name),
    used = new Set(),
    map = {};
  const own =
    names.includes("time") &&
    CHANNELS.filter((c) => names.includes(c) || names.includes(`${c}_left`)).length > 3;
  for (const channel of CHANNELS)
    map[channel] = { column: "", other: "", unit: findSiUnit(channel, lib), sign: 1, ratio: 1 };
  const take = (channel, column, other = "") => {
    for (const n of [column, other]) used.add(n);
    map[channel].column = column;
    map[channel].other = other;
  };
  for (const c of CHANNELS) {
    if (names.includes(c)) take(c, c);
    else if (names.includes(`${c}_left`) && names.includes(`${c}_right`)) take(c, `${c}_left`, `${c}_right`);
  }
  if (own) return { map, own, guessed: [] };
  const guessed = [];
  const plain = new Map(names.map((n) => [n, splitUnit(n)[0]]));
  if (!map.time.column) {
    const sounds = names.find((n) => matches(TIME_NAME, splitWords(plain.get(n)).join(" ")));
    const rising = table.columns.find((c) => isRising(c.values));
    const found = sounds ?? rising?.name;
    if (found) {
      take("time", found);
      guessed.push("time");
    }
  }
  for (const channel of ["yaw_rate", "steer_angle", "accel_y", "accel_x"]) {
    if (map[channel].column) continue;
    const best = names
      .filter((n) => !used.has(n))
      .map((n) => [scoreName(channel, plain.get(n)), n])
      .sort((a, b) => b[0] - a[0])[0];
    if (best?.[0] > 1) {
      take(channel, best[1]);
      guessed.push(channel);
    }
  }
  const wheels = {};
  for (const n of names) {
    const [place, worth] = used.has(n) ? ["", 0] : findPlace(plain.get(n));
    if (place && worth > (wheels[place]?.worth ?? 1)) wheels[place] = { worth, name: n };
  }
  for (const axle of ["front", "rear"]) {
    const channel = `wheel_speed_${axle}`,
      left = wheels[`${axle}_left`],
      right = wheels[`${axle}_right`];
    if (map[channel].column) continue;
    if (left && right) take(channel, left.name, right.name);
    else if (wheels[axle]) take(channel, wheels[axle].name);
    else continue;
    guessed.push(channel);
  }
  for (const channel of CHANNELS) {
    const column = table.columns.find((c) => c.name === map[channel].column);
    if (column) map[channel].unit = chooseUnit(channel, column, lib);
  }
  return { map, own, guessed };
}

const findSiUnit = (channel, lib) => (channel === "time" ? "s" : lib.field("input", channel).unit);

function isRising(values) {
  if (values.length < 2) return false;
  let up = 0;
  for (let i = 1; i < values.length; i++) up += values[i] > values[i - 1];
  return up > 0.95 * (values.length - 1);
}

// Units that a channel may have
const CHOICES = {
  time: ["s", "ms", "us", "ns"],
  angle: ["rad", "deg"],
  rate: ["rad/s", "deg/s"],
  wheel: ["rad/s", "rpm", "km/h", "m/s", "mph"],
  accel: ["m/s2", "g"],
};
function listUnits(channel) {
  if (channel === "time") return CHOICES.time;
  if (channel === "steer_angle") return CHOICES.angle;
  if (channel === "yaw_rate") return CHOICES.rate;
  return isAxle(channel) ? CHOICES.wheel : CHOICES.accel;
}

const findStatedUnit = (column) => findUnit(column.unit) || findUnit(splitUnit(column.name)[1]) || "";

// Return the guessed channels whose unit is stated neither by the file nor by the name.
function listOpenChannels(file) {
  const open = new Set();
  for (const channel of file.guessed) {
    const column = file.table.columns.find((c) => c.name === file.map[channel].column);
    if (column && channel !== "time" && channel !== "steer_angle" && !findStatedUnit(column))
      open.add(isAxle(channel) ? "wheel_speed" : channel);
  }
  return open;
}

function chooseUnit(channel, column, lib) {
  const said = findStatedUnit(column);
  const choices = listUnits(channel),
    si = findSiUnit(channel, lib);
  if (said) {
    const factor = (u) => findFactor(u, si, isAxle(channel) ? 1 : null);
    const same = choices.find((u) => PAGE.spelt[findUnit(u)] === PAGE.spelt[said] && factor(u) !== null);
    if (same) return same;
  }
  const size = computeQuantile(column.values, 0.99);
  if (channel === "time") return guessTimeUnit(column.values);
  if (channel === "steer_angle") return size > lib.field("input", channel).hi ? "deg" : "rad";
  if (channel === "yaw_rate") return size > 2.5 ? "deg/s" : "rad/s"; // a car at 2.5 rad/s spins
  return choices[0];
}

// Return the unit of a time by its steps: rows of a log are 1 ms to 1 s apart.
function guessTimeUnit(values) {
  const step = computeMedian(computeSteps(values));
  return step > 2e5 ? "ns" : step > 500 ? "us" : step > 1 ? "ms" : "s";
}

function computeQuantile(values, q) {
  const stride = Math.max(1, Math.floor(values.length / 20000)),
    some = [];
  for (let i = 0; i < values.length; i += stride)
    if (Number.isFinite(values[i])) some.push(Math.abs(values[i]));
  some.sort((a, b) => a - b);
  return some.length ? some[Math.min(some.length - 1, Math.floor(q * some.length))] : 0;
}

function computeSteps(x) {
  const out = new Float64Array(Math.max(0, x.length - 1));
  for (let i = 0; i < out.length; i++) out[i] = x[i + 1] - x[i];
  return out;
}

// Return the median as numpy does.
function computeMedian(x) {
  const sorted = Float64Array.from(x).sort(),
    n = sorted.length;
  return n ? (n % 2 ? sorted[(n - 1) / 2] : (sorted[n / 2 - 1] + sorted[n / 2]) / 2) : NaN;
}

// max share of rows whose time is not later than that of the row before (tse/log/rows.py)
const MAX_BACK = 0.5;
const FEW_OUTSIDE = 0.05; // max share of values outside the range; above it the column is wrong
const MAX_SAMPLE_TIME = 1.0; // s: max median step of the rows
const MAX_STEP = 3600; // s: limit of the library

// Return checked rows in SI: {time, data: channel -> Float64Array, NaN: missing,
// sampleTime, notes}. Throws Wrong.
function checkRows(table, map, car, lib) {
  const notes = [...table.notes],
    name = table.name;
  const column = (n) => table.columns.find((c) => c.name === n);
  for (const channel of NEEDED) {
    if (map[channel].column) continue;
    const why =
      channel === "time"
        ? "Every row needs a time"
        : "Without the steering angle the tyres cannot be estimated";
    const has = table.columns.map((c) => c.name).join(", ");
    throw new Wrong(`${name}: which column is ${channel}? ${why}. The file has: ${has.slice(0, 300)}`);
  }
  const axles = CHANNELS.filter(isAxle).filter((c) => map[c].column);
  if (!axles.length)
    throw new Wrong(`${name}: which columns are the wheel speeds? At least one axle is needed`);
  const picked = {};
  for (const channel of CHANNELS) {
    const m = map[channel],
      parts = [m.column, m.other].filter(Boolean);
    if (!parts.length) continue;
    const radius = isAxle(channel) ? car[channel.replace("wheel_speed", "wheel_radius")] : null;
    const factor = findFactor(m.unit, findSiUnit(channel, lib), radius);
    if (factor === null)
      throw new Wrong(
        `${name}: ${channel} cannot have the unit ${m.unit}; allowed: ${listUnits(channel).join(", ")}`,
      );
    if (!(m.ratio > 0))
      throw new Wrong(
        `${name}: ${channel}: the steering ratio must be above 0; 1: the column is the angle of the ` +
          "road wheels",
      );
    const series = parts.map((n) => {
      const c = column(n);
      if (c.bad && c.bad.count > FEW_OUTSIDE * c.values.length) {
        throw new Wrong(
          `${name}: ${table.place} ${c.bad.line}, column ${n}: "${c.bad.text.slice(0, 40)}" is not a ` +
            "number; allowed: " +
            `${channel === "time" ? "seconds, increasing" : formatRange(lib.field("input", channel))}, ` +
            "or empty for missing",
        );
      }
      if (c.bad)
        notes.push(
          `${n}: ${c.bad.count} cells that are no numbers are treated as missing (first in ` +
            `${table.place} ${c.bad.line}: "${c.bad.text.slice(0, 20)}")`,
        );
      if (c.values.every(Number.isNaN)) throw new Wrong(`${name}: column ${n}: every cell is empty`);
      const gain = factor * m.sign;
      if (gain === 1 && m.ratio === 1) return c.values;
      return c.values.map((x) => (gain === 1 ? x : x * gain) / m.ratio);
    });
    if (channel === "time") picked.time = [series[0]];
    else {
      const f = lib.field("input", channel);
      picked[channel] = series.map((x, k) => maskOutside(x, f, parts[k], table, notes));
    }
  }
  const { time, keep } = selectForward(
    picked.time[0],
    table,
    CHANNELS.slice(1).flatMap((c) => picked[c] ?? []),
    notes,
  );
  const data = {},
    turn = {};
  for (const f of lib.channels) {
    const parts = picked[f.name]?.map((x) => Float64Array.from(keep, (i) => x[i]));
    data[f.name] = !parts
      ? new Float64Array(keep.length).fill(NaN)
      : parts.length === 1
        ? parts[0]
        : joinAxle(f.name, ...parts, picked.yaw_rate?.[0], keep, notes, turn);
    if (!parts && !isAxle(f.name)) {
      notes.push(`${f.name} is not in the log: quantities that only ${f.name} shows are not estimated`);
    }
  }
  if (["accel_y", "yaw_rate"].every((c) => data[c].every(Number.isNaN))) {
    throw new Wrong(
      `${name}: accel_y and yaw_rate are missing: the tyres cannot be estimated without one of them`,
    );
  }
  if (axles.length === 1) {
    const [there] = axles,
      absent = CHANNELS.filter(isAxle).find((c) => c !== there);
    const radius = (c) => car[c.replace("wheel_speed", "wheel_radius")];
    data[absent] = data[there].map((x) => x * (radius(there) / radius(absent)));
    data.accel_x = data.accel_x.map(() => NaN);
    notes.push(
      `${absent} is not in the log: ${there} stands in for it; slip is not known, so accel_x is not ` +
        "used and cx_front not estimated",
    );
  }
  const rows = { name, time, data, notes, turn };
  rows.sampleTime = rows.time.length > 1 ? computeMedian(computeSteps(rows.time)) : null;
  if (rows.sampleTime > MAX_SAMPLE_TIME) {
    throw new Wrong(
      `${name}: column ${map.time.column}: rows are ` +
        `${formatNumber(rows.sampleTime)} s apart (median); ` +
        `allowed: up to ${MAX_SAMPLE_TIME} s. If the column holds milliseconds, choose ms`,
    );
  }
  rows.truth = Object.fromEntries(
    STIFFNESS.filter((s) => column(`ref_${s}`)).map((s) => {
      const x = column(`ref_${s}`).values;
      return [s, Float64Array.from(keep, (i) => x[i])];
    }),
  );
  return rows;
}

function maskOutside(values, f, name, table, notes) {
  let bad = 0,
    first = -1;
  for (let i = 0; i < values.length; i++) {
    if (values[i] < f.lo || values[i] > f.hi) {
      bad++;
      if (first < 0) first = i;
    }
  }
  if (!bad) return values;
  if (bad > FEW_OUTSIDE * values.length) {
    const hint =
      f.name === "steer_angle" ? "choose degrees, or state the steering ratio" : "choose another unit";
    throw new Wrong(
      `${table.name}: ${table.place} ${table.line[first]}, column ${name}: ${formatNumber(values[first])} ` +
        `${f.unit} is outside the allowed range ${formatRange(f)} (${bad} such rows). Is the unit ` +
        `wrong? Then ${hint}`,
    );
  }
  notes.push(
    `${name}: ${bad} values outside ${formatRange(f)} are treated as missing (first in ${table.place} ` +
      `${table.line[first]})`,
  );
  return values.map((x) => (x < f.lo || x > f.hi ? NaN : x));
}

// Return the mean speed of an axle from its two wheels. If one wheel is missing, its
// speed is computed from the other wheel and the yaw rate: right - left = track / radius
// x yaw rate. The factor is found from rows with both wheels (tse/log/rows.py). It is
// also stored in `turn` if it explains enough of the difference (PAGE.check.turnShown).
function joinAxle(name, left, right, yawRate, keep, notes, turn) {
  const mean = left.map((x, i) => 0.5 * (x + right[i]));
  if (!yawRate) return mean;
  const yaw = keep.map((i) => yawRate[i]);
  let turned = 0,
    along = 0,
    differed = 0,
    alone = 0;
  for (let i = 0; i < mean.length; i++) {
    const difference = right[i] - left[i];
    if (!Number.isFinite(difference) || !Number.isFinite(yaw[i])) continue;
    turned += yaw[i] ** 2;
    along += difference * yaw[i];
    differed += difference ** 2;
  }
  if (turned > 0 && along ** 2 > PAGE.check.turnShown * differed * turned) turn[name] = along / turned;
  for (let i = 0; turned > 0 && i < mean.length; i++) {
    const there = Number.isFinite(left[i]);
    if (!Number.isNaN(mean[i]) || !(there || Number.isFinite(right[i])) || !Number.isFinite(yaw[i])) continue;
    const half = 0.5 * (along / turned) * yaw[i];
    mean[i] = there ? left[i] + half : right[i] - half;
    alone++;
  }
  if (alone)
    notes.push(
      `${name}: one of both wheels is missing in ${alone} rows: its speed is computed from the other ` +
        "wheel and the yaw rate",
    );
  return mean;
}

// Return {time, keep}: the corrected times, which increase, and the indices of their
// rows. Rows without a time are left out, with a note if they have values. Throws Wrong
// if the column is no time.
function selectForward(all, table, columns, notes) {
  const where = (i) => `${table.place} ${table.line[i]}`;
  const at = [];
  let without = 0,
    first = -1;
  for (let i = 0; i < all.length; i++) {
    if (Number.isFinite(all[i])) at.push(i);
    else if (columns.some((c) => !Number.isNaN(c[i]))) {
      if (!without++) first = i;
    }
  }
  if (at.length + without === 0) throw new Wrong(`${table.name}: has no rows with numbers`);
  if (at.length < MAX_BACK * (at.length + without))
    throw new Wrong(`${table.name}: ${where(first)}, time: is empty or not finite; every row needs a time`);
  const t = Float64Array.from(at, (i) => all[i]),
    back = computeSteps(t).map((d) => (d <= 0 ? 1 : 0)),
    count = back.reduce((n, x) => n + x, 0);
  if (count > MAX_BACK * back.length) {
    const k = back.indexOf(1);
    throw new Wrong(
      `${table.name}: ${where(at[k + 1])}, time: ${formatNumber(t[k + 1], 10)} is ` +
        `${t[k + 1] === t[k] ? "the same time as" : "earlier than"} ${where(at[k])} ` +
        `(${formatNumber(t[k], 10)}); time must increase from row to row (${count} such rows)`,
    );
  }
  const done = straighten(t);
  if (without) notes.push(`time: ${without} entries without a time are left out`);
  notes.push(...done.notes.map((x) => `time: ${x}`));
  if (done.kept.length < MAX_BACK * all.length && count)
    throw new Wrong(
      `${table.name}: time does not go on in ${count} rows; time must increase from row to row`,
    );
  return { time: done.time, keep: done.kept.map((k) => at[k]) };
}

// max delay of an entry that is out of order, in rows and in s
const LATE_ROWS = 8,
  LATE_TIME = 0.5;
const BRIDGED = 60; // s: gap that replaces a jump of the clock by more than MAX_STEP

// Return corrected times, as scripts/tse/log/clock.py: {time, kept: entries, notes}.
function straighten(given) {
  const notes = [],
    step = computeSteps(given),
    kept = [...given.keys()];
  if (given.length < 2 || (step.every((d) => d > 0) && step.every((d) => d <= MAX_STEP)))
    return { time: given, kept, notes };
  const ahead = step.filter((d) => d > 0),
    usual = ahead.length ? computeMedian(ahead) : 0.01;
  const t = Float64Array.from(given),
    late = new Set(),
    sets = [];
  let highest = t[0];
  for (let i = 1; i < t.length; i++) {
    if (t[i] >= highest) {
      highest = t[i];
      continue;
    }
    const back = highest - t[i],
      again = t.subarray(i + 1, i + 1 + LATE_ROWS).findIndex((x) => x > highest);
    if (back <= LATE_TIME && again >= 0 && again < Math.floor(LATE_ROWS / 2)) {
      late.add(i);
      continue;
    }
    sets.push([highest, back]);
    for (let k = i; k < t.length; k++) t[k] += back + usual;
    highest = t[i];
  }
  if (sets.length)
    notes.push(
      `the clock goes back ${sets.length} time${sets.length > 1 ? "s" : ""} (first by ` +
        `${formatNumber(sets[0][1], 3)} s at ${sets[0][0].toFixed(3)} s): ` +
        "all later times are shifted, to continue one usual step later",
    );
  if (late.size) notes.push(`${late.size} entries are out of order: left out`);
  let at = kept.filter((i) => !late.has(i)),
    time = Float64Array.from(at, (i) => t[i]);
  const same = [...time.keys()].filter((i) => i + 1 < time.length && time[i + 1] === time[i]);
  if (same.length > 0.2 * time.length) {
    time = spreadTicks(time);
    notes.push(
      `the resolution of the clock is too coarse (${Math.round((100 * same.length) / time.length)} % of ` +
        "the entries have the time of the next one): entries are spread evenly up to the next time",
    );
  } else if (same.length) {
    notes.push(
      `${same.length} entries have the same time as the next entry (first at ${time[same[0]].toFixed(3)} ` +
        "s): left out",
    );
    const gone = new Set(same);
    at = at.filter((_, i) => !gone.has(i));
    time = time.filter((_, i) => !gone.has(i));
  }
  const jump = computeSteps(time),
    far = jump.findIndex((d) => d > MAX_STEP);
  if (far >= 0) {
    notes.push(
      `the clock jumps ahead by ${formatNumber(jump[far])} s at ${time[far].toFixed(3)} s: replaced by ` +
        `a gap of ${BRIDGED} s`,
    );
    let off = 0;
    time = time.map((x, i) => {
      if (i && jump[i - 1] > MAX_STEP) off += jump[i - 1] - BRIDGED;
      return x - off;
    });
  }
  return { time, kept: at, notes };
}

// Return the times, with entries of equal time spread evenly up to the next time.
function spreadTicks(t) {
  const ticks = Float64Array.from(new Set(t)).sort(),
    count = new Map();
  for (const x of t) count.set(x, (count.get(x) ?? 0) + 1);
  const usual = ticks.length > 1 ? computeMedian(computeSteps(ticks)) : 0.01;
  const whole = ticks.map((x, i) => (i + 1 < ticks.length ? ticks[i + 1] : x + usual) - x),
    most = 2 * computeMedian(whole);
  const length = new Map([...ticks].map((x, i) => [x, Math.min(whole[i], most)]));
  let place = 0;
  return t.map((x, i) => {
    place = i && t[i - 1] === x ? place + 1 : 0;
    return x + place * (length.get(x) / count.get(x));
  });
}

// Estimate sign and ratio of the steering from the rows: {gain: logged angle / angle of
// the road wheels, sd: sd of ln |gain|}. null: too few bends.
function estimateSteeringGain(rows, car) {
  const d = smoothChannels(selectLiveliest(rows, PAGE.check.mostRows)),
    s = fitSteering(
      d.steer_angle,
      d.wheel_speed_rear.map((w) => w * car.wheel_radius_rear),
      d.yaw_rate,
    );
  return s && s.share > PAGE.check.enough.steer_angle && s.perCurvature !== 0
    ? { gain: s.perCurvature / (car.lf + car.lr), sd: s.sd }
    : null;
}
