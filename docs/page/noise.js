// noise.js - noise and bias of sensors that nobody has described, from the log: the rules of scripts/tselab/noise.py and of
// fill_sensors() in vehicle.py, whose constants are in PAGE.noise. tests/page compares the two.

// Settings of tse/sensors.def as the rules fill them in, clipped to their ranges; what the log does not tell is left out.
function sensorsOf(all, car, lib) {
  const P = PAGE.noise, rows = liveliest(all, P.mostRows), out = {};
  const put = (name, value) => {
    const f = lib.field("config", name);
    out[name] = Math.min(Math.max(value, f.lo), f.hi);
  };
  const moving = rows.data.wheel_speed_front.map((w) => (Math.abs(w) * car.wheel_radius_front > 2 ? 1 : 0));
  if (car.model_sd > 0) put("nod_time", P.nodTime);
  const wheels = ["front", "rear"].map((a) => channelNoise(`wheel_speed_${a}`, rows.data[`wheel_speed_${a}`], moving)).filter((x) => x !== null);
  if (wheels.length) put("wheel_noise_sd", Math.max(...wheels));
  const misfits = kinematicMisfit(rows, car);
  for (const c of ["accel_x", "accel_y", "yaw_rate"]) {
    if (rows.data[c].every(Number.isNaN)) continue;
    const sd = channelNoise(c, rows.data[c], moving), misfit = misfits[c];
    if (sd === null) continue;
    put(`${c}_sd`, Math.max(sd, misfit?.sd ?? 0));
    put(`${c}_bias_sd`, Math.max(P.unknownBias[`${c}_bias_sd`], misfit?.bias ?? 0));
    if (misfit) put(`${c}_bias_walk`, Math.max(misfit.walk, lib.field("config", `${c}_bias_walk`).def));
  }
  return out;
}

function channelNoise(name, all, moving) {
  const P = PAGE.noise, there = all.filter((v) => Number.isFinite(v)), rolling = all.filter((v, i) => Number.isFinite(v) && moving[i]);
  const x = rolling.length >= P.fewestRows ? rolling : there;
  if (x.length < P.fewestRows) return null;
  const scale = name.startsWith("wheel") ? deviation(differences(x)) || 1 : median(offsets(x)) || deviation(x) || 1;
  const hold = holdOf(x, scale), second = new Float64Array(x.length - 2 * hold);
  for (let i = 0; i < second.length; i++) second[i] = Math.abs(x[i + 2 * hold] - 2 * x[i + hold] + x[i]);
  let sd = (1.4826 * median(second)) / Math.sqrt(6);
  sd = Math.max(sd, quantum(x) / Math.sqrt(12));
  if (hold > 1) sd *= Math.sqrt(hold);
  return Math.max(sd, P.floor[name]);
}

function offsets(x) {
  const middle = median(x);
  return x.map((v) => Math.abs(v - middle));
}

const meanOf = (x) => x.reduce((sum, v) => sum + v, 0) / x.length;

function deviation(x) {
  const mean = meanOf(x);
  return Math.sqrt(x.reduce((sum, v) => sum + (v - mean) ** 2, 0) / x.length);
}

// Rows per independent sample: 1 when no straight stretches are seen.
function holdOf(x, scale) {
  const quiet = (d) => d.reduce((n, v) => n + (Math.abs(v) < 1e-3 * scale), 0) / d.length;
  const first = differences(x), still = Math.max(quiet(first), quiet(differences(first)));
  return Math.min(Math.max(Math.round(1 / Math.max(1e-9, 1 - still)), 1), PAGE.noise.longestHold);
}

// The step between the values a coarse channel takes; 0 for a fine one.
function quantum(x) {
  const counts = new Map();
  for (const v of x) {
    const at = Math.round(v * 1e12) / 1e12;
    counts.set(at, (counts.get(at) ?? 0) + 1);
  }
  const few = Math.max(5, 0.002 * x.length), common = [...counts].filter(([, n]) => n >= few);
  if (common.length < 2 || common.reduce((sum, [, n]) => sum + n, 0) / x.length < 0.5) return 0;
  return median(differences(Float64Array.from(common, ([v]) => v).sort()));
}

// How far the accelerometers disagree with wheel speeds and gyro: {accel_x: {sd, bias, walk}, ...}; empty when the log moves too little.
function kinematicMisfit(rows, car) {
  const P = PAGE.noise, { time, sampleTime } = rows;
  if (!sampleTime) return {};
  const d = Object.fromEntries(Object.entries(rows.data).map(([name, x]) => [name, filled(x)]));
  const speed = time.map((_, i) => 0.5 * (car.wheel_radius_front * d.wheel_speed_front[i] + car.wheel_radius_rear * d.wheel_speed_rear[i]));
  const [average, window, change] = [P.average, P.window, P.change].map((s) => Math.max(1, Math.round(s / sampleTime)));
  const moving = speed.map((v) => (Math.abs(v) > P.moving ? 1 : 0)), out = {};
  for (const [name, kinematic] of [["accel_x", gradient(speed, time)], ["accel_y", speed.map((v, i) => v * d.yaw_rate[i])]]) {
    if (!d[name].some(Number.isFinite) || !kinematic.some(Number.isFinite)) continue;
    const residual = smooth(d[name].map((v, i) => v - kinematic[i]), average), slow = smooth(residual, window);
    const fast = residual.map((v, i) => v - slow[i]), windows = [], changes = [];
    for (let i = 0; i + window <= fast.length; i += window) {
      if (moving.subarray(i, i + window).every(Boolean)) windows.push(deviation(fast.subarray(i, i + window)));
    }
    for (let i = change; i < slow.length; i++) if (moving[i] && moving[i - change]) changes.push(Math.abs(slow[i] - slow[i - change]));
    if (windows.length < 5 || !changes.length) continue;
    const rolling = slow.filter((_, i) => moving[i]), middle = median(rolling);
    out[name] = {
      sd: quantile(windows, P.quiet) * Math.sqrt(average),
      bias: quantile(rolling.map((v) => Math.abs(v - middle)), P.quiet) / P.normalQuiet + Math.abs(middle),
      walk: quantile(changes, P.quiet) / P.normalQuiet,
    };
  }
  return out;
}

function quantile(x, q) {
  const sorted = Float64Array.from(x).sort(), at = q * (sorted.length - 1), low = Math.floor(at);
  return sorted[low] + (at - low) * ((sorted[low + 1] ?? sorted[low]) - sorted[low]);
}

// Missing values on the straight line between their neighbours.
function filled(x) {
  const out = Float64Array.from(x);
  let last = -1;
  for (let i = 0; i < x.length; i++) {
    if (!Number.isFinite(x[i])) continue;
    for (let k = last + 1; k < i; k++) out[k] = last < 0 ? x[i] : x[last] + ((x[i] - x[last]) * (k - last)) / (i - last);
    last = i;
  }
  for (let k = last + 1; last >= 0 && k < x.length; k++) out[k] = x[last];
  return out;
}

// As numpy.gradient() on uneven times.
function gradient(x, t) {
  const n = x.length, out = new Float64Array(n);
  if (n < 2) return out;
  out[0] = (x[1] - x[0]) / (t[1] - t[0]);
  out[n - 1] = (x[n - 1] - x[n - 2]) / (t[n - 1] - t[n - 2]);
  for (let i = 1; i < n - 1; i++) {
    const a = t[i] - t[i - 1], b = t[i + 1] - t[i];
    out[i] = (-b / (a * (a + b))) * x[i - 1] + ((b - a) / (a * b)) * x[i] + (a / (b * (a + b))) * x[i + 1];
  }
  return out;
}

// Moving average over n rows, ends repeated.
function smooth(x, n) {
  const out = new Float64Array(x.length), before = Math.floor(n / 2), last = x.length - 1;
  const at = (i) => x[Math.min(Math.max(i, 0), last)];
  // out[i] is the mean of the padded x from i to i + n - 1
  let sum = 0;
  for (let k = 0; k < n; k++) sum += at(k - before);
  for (let i = 0; i <= last; i++) {
    out[i] = sum / n;
    sum += at(i + n - before) - at(i - before);
  }
  return out;
}
