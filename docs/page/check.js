// check.js - check whether the channels of a log agree with each other.
//
// This is a third implementation of scripts/tse/channels (agree.py, physics.py), with the
// same tables and constants (PAGE.check). tests/page compares its warnings with those of
// tselab. It leaves out:
// - the checks of brake, wheel torques, velocities, course, delays and false stops,
// - the check of the time of slow logs, and the search for a mistake in parts of a log,
// - splines: the raster has means of the rows around each point, so figures agree within
//   a few percent.
//
// A figure is the ratio of a measured value to the value that other channels predict, for
// example accel_y / (speed x yaw_rate). It is about 1 if the channels are right. A cause
// is a possible mistake, a wrong unit or sign of a channel, with the factor of this
// mistake.

// Return the channels on an even raster of PAGE.check.rate, Hz, as moving means over
// PAGE.check.smooth: name -> Float64Array, NaN: missing.
function smoothChannels(rows) {
  const P = PAGE.check,
    { time } = rows,
    first = time[0],
    count = Math.max(0, Math.ceil((time.at(-1) - first) * P.rate));
  const longest = Math.max(5 * rows.sampleTime, 0.5),
    out = {};
  for (const [name, x] of Object.entries(rows.data)) {
    const raster = new Float64Array(count).fill(NaN);
    let at = 0,
      before = -1;
    for (let k = 0; k < count; k++) {
      const t = first + k / P.rate,
        from = t - 0.5 / P.rate,
        to = t + 0.5 / P.rate;
      let sum = 0,
        n = 0;
      for (; at < time.length && time[at] < to; at++) {
        if (!Number.isFinite(x[at])) continue;
        before = at;
        if (time[at] >= from) {
          sum += x[at];
          n++;
        }
      }
      if (n) raster[k] = sum / n;
      else if (before >= 0) {
        // rows are further apart than the raster: interpolate
        let next = at;
        while (next < time.length && !Number.isFinite(x[next])) next++;
        if (next < time.length && time[next] - time[before] <= longest) {
          raster[k] = x[before] + ((x[next] - x[before]) * (t - time[before])) / (time[next] - time[before]);
        }
      }
    }
    out[name] = averageMoving(raster, Math.max(1, Math.round(P.smooth * P.rate)));
  }
  return out;
}

const computeMean = (x) => x.reduce((sum, v) => sum + v, 0) / x.length;

function computeDeviation(x) {
  const mean = computeMean(x);
  return Math.sqrt(x.reduce((sum, v) => sum + (v - mean) ** 2, 0) / x.length);
}

// Return the part of a long log in which the car turns most, as
// tse.log.rows.select_liveliest() does.
function selectLiveliest(rows, most) {
  const n = rows.time.length;
  if (n <= most) return rows;
  const channel = rows.data[rows.data.yaw_rate.some(Number.isFinite) ? "yaw_rate" : "steer_angle"],
    step = Math.floor(most / 4),
    turned = [];
  for (let i = 0; i < n; i += step)
    turned.push(
      channel.subarray(i, i + step).reduce((sum, x) => sum + (Number.isFinite(x) ? Math.abs(x) : 0), 0),
    );
  let best = 0,
    at = 0;
  for (let k = 0; k * step + most <= n; k++) {
    const sum = turned.slice(k, k + 4).reduce((a, b) => a + b, 0);
    if (sum > best) [best, at] = [sum, k * step];
  }
  const data = Object.fromEntries(
    Object.entries(rows.data).map(([name, x]) => [name, x.subarray(at, at + most)]),
  );
  return { ...rows, time: rows.time.subarray(at, at + most), data };
}

// Return means over n rows, NaN where more than half is missing. The alignment is that of
// numpy.convolve(x, ones(n), "same").
function averageMoving(x, n) {
  const sums = new Float64Array(x.length + 1),
    counts = new Int32Array(x.length + 1);
  for (let i = 0; i < x.length; i++) {
    const there = Number.isFinite(x[i]);
    sums[i + 1] = sums[i] + (there ? x[i] : 0);
    counts[i + 1] = counts[i] + (there ? 1 : 0);
  }
  return x.map((_, i) => {
    const from = Math.max(0, i - Math.floor(n / 2)),
      to = Math.min(x.length, i + Math.ceil(n / 2));
    const count = counts[to] - counts[from];
    return count > 0.5 * n ? (sums[to] - sums[from]) / count : NaN;
  });
}

// Fit y = slope x + offset where keep(i): {slope, corr}. corr 0: too few rows.
function fitLine(x, y, keep = () => true) {
  let n = 0,
    sx = 0,
    sy = 0;
  const use = (i) => Number.isFinite(x[i]) && Number.isFinite(y[i]) && keep(i);
  for (let i = 0; i < x.length; i++)
    if (use(i)) {
      n++;
      sx += x[i];
      sy += y[i];
    }
  if (n < PAGE.check.fewest) return { slope: 0, corr: 0, rows: n };
  const mx = sx / n,
    my = sy / n;
  let xx = 0,
    yy = 0,
    xy = 0;
  for (let i = 0; i < x.length; i++)
    if (use(i)) {
      xx += (x[i] - mx) ** 2;
      yy += (y[i] - my) ** 2;
      xy += (x[i] - mx) * (y[i] - my);
    }
  if (Math.sqrt(xx / n) < 1e-12 || Math.sqrt(yy / n) < 1e-12) return { slope: 0, corr: 0, rows: n };
  const corr = xy / Math.sqrt(xx * yy);
  return { slope: Math.sign(corr) * Math.sqrt(yy / xx), corr, rows: n, sd: Math.sqrt(yy / n) };
}

// Return the derivative, 1/s, as numpy.gradient().
function differentiate(x) {
  const n = x.length,
    r = PAGE.check.rate;
  return x.map(
    (_, i) =>
      (n < 2 ? 0 : i === 0 ? x[1] - x[0] : i === n - 1 ? x[i] - x[i - 1] : 0.5 * (x[i + 1] - x[i - 1])) * r,
  );
}

// Fit the steering angle over the curvature, as physics.fit_steering():
// {perCurvature, sd, share}, or null.
function fitSteering(angle, v, yaw) {
  const P = PAGE.check,
    y = [],
    c = [],
    v2 = [];
  for (let i = 0; i < v.length; i++) {
    const k = yaw[i] / v[i];
    if (v[i] > P.moving && Number.isFinite(angle[i]) && Number.isFinite(k)) {
      y.push(angle[i]);
      c.push(k);
      v2.push(v[i] ** 2);
    }
  }
  if (y.length < P.fewest || computeDeviation(c) < 1e-5 || computeDeviation(y) < 1e-9) return null;
  const independent = Math.max(y.length / (2 * P.smooth * P.rate), 1),
    my = computeMean(y),
    yy = computeDeviation(y) ** 2,
    tried = [];
  for (let g = 0; g <= 40; g++) {
    const k = P.understeer + (-3 + (8 * g) / 40) * P.understeerSd,
      x = c.map((value, i) => value * (1 + k * v2[i]));
    const sx = computeDeviation(x),
      mx = computeMean(x);
    if (sx < 1e-12) {
      tried.push({ k, slope: 0, share: 0 });
      continue;
    }
    let xy = 0;
    for (let i = 0; i < x.length; i++) xy += (x[i] - mx) * (y[i] - my);
    const slope = xy / x.length / sx ** 2;
    let left = 0;
    for (let i = 0; i < x.length; i++) left += (y[i] - my - slope * (x[i] - mx)) ** 2;
    tried.push({ k, slope, share: 1 - left / y.length / yy });
  }
  const worth = tried.map(
    (t) =>
      -0.5 * independent * Math.log(Math.max(1 - t.share, 1e-4)) -
      0.5 * ((t.k - P.understeer) / P.understeerSd) ** 2,
  );
  const top = Math.max(...worth),
    weight = worth.map((w) => Math.exp(w - top)),
    total = weight.reduce((a, b) => a + b, 0);
  const size = tried.map((t) => Math.log(Math.max(Math.abs(t.slope), 1e-12)));
  const mean = size.reduce((s, x, i) => s + weight[i] * x, 0) / total,
    square = size.reduce((s, x, i) => s + weight[i] * x * x, 0) / total;
  const best = tried[worth.indexOf(top)],
    apart = -0.5 * Math.log(Math.max(best.share, 1e-2));
  return {
    perCurvature: best.slope * Math.exp(apart),
    sd: Math.hypot(Math.sqrt(Math.max(square - mean * mean, 0)), apart / Math.sqrt(3)),
    share: best.share,
  };
}

// Return the figures: name -> {value, sd of ln(value), nearly: the correlation is only
// just too small}. `v`: speed, m/s.
function computeFigures(rows, d, v, car, tracks, wheels) {
  const P = PAGE.check,
    out = {},
    moving = (i) => Math.abs(v[i]) > P.moving;
  for (const [name, kinematic] of [
    ["accel_y", v.map((x, i) => x * d.yaw_rate[i])],
    ["accel_x", differentiate(v)],
  ]) {
    const f = fitLine(kinematic, d[name], moving);
    if (Math.abs(f.corr) > P.enough[name] - P.slack && f.sd > 0.02)
      out[name] = {
        value: f.slope,
        sd: Math.hypot(P.sd[name], 1 - Math.abs(f.corr)),
        nearly: Math.abs(f.corr) <= P.enough[name],
      };
  }
  const s = fitSteering(d.steer_angle, v, d.yaw_rate);
  if (s && s.share > P.enough.steer_angle - P.slack && s.perCurvature !== 0)
    out.steer_angle = {
      value: s.perCurvature / (car.lf + car.lr),
      sd: Math.hypot(P.sd.steer_angle, s.sd),
      nearly: s.share <= P.enough.steer_angle,
    };
  for (const axle of ["front", "rear"]) {
    const per = rows.turn?.[`wheel_speed_${axle}`];
    if (per)
      out[`track_${axle}`] = {
        value: (per * car[`wheel_radius_${axle}`]) / wheels / (tracks[axle] || P.unknownTrack),
        sd: tracks[axle] ? P.sd.track : P.unknownTrackSd,
      };
  }
  return out;
}

// Return the figures that remain after the causes are corrected: name -> value.
function applyCauses(figures, causes) {
  const by = { yaw_rate: 1, accel_y: 1, accel_x: 1, steer_angle: 1 };
  for (const c of causes) if (c.channel in by) by[c.channel] *= c.factor;
  const expected = {
    accel_y: by.accel_y / by.yaw_rate,
    accel_x: by.accel_x,
    steer_angle: by.steer_angle / by.yaw_rate,
    track_front: 1 / by.yaw_rate,
    track_rear: 1 / by.yaw_rate,
  };
  return Object.fromEntries(Object.entries(figures).map(([name, f]) => [name, f.value / expected[name]]));
}

function computeCost(figures, causes) {
  const left = applyCauses(figures, causes);
  return Object.entries(left).reduce(
    (sum, [n, x]) => sum + (Math.log(Math.abs(x)) / figures[n].sd) ** 2 + (x < 0 ? PAGE.check.wrongSign : 0),
    0,
  );
}

// Return the set of causes with min cost: {causes, cost, figures, plain: figures without
// any cause}. If there are no figures, the set is empty. `may(channel, unit)`: whether a
// cause is tried. `price(unit)`: cost of a cause. `most`: max number of causes in
// addition to one of the wheels. `without`: names of figures to ignore.
function findBestCauses(
  rows,
  car,
  {
    ratio = PAGE.check.usualRatio,
    tracks = {},
    may = () => true,
    price = () => PAGE.check.price,
    most = 2,
    without = [],
  } = {},
) {
  const P = PAGE.check,
    d = smoothChannels(selectLiveliest(rows, P.mostRows));
  const front = d.wheel_speed_front.map((x) => x * car.wheel_radius_front),
    rear = d.wheel_speed_rear.map((x) => x * car.wheel_radius_rear);
  const v = front.map((x, i) => 0.5 * (x + rear[i])),
    radius = 0.5 * (car.wheel_radius_front + car.wheel_radius_rear);
  const single = P.causes
    .map(([channel, per, power, unit, text]) => ({
      channel,
      factor: per * ratio ** power,
      unit,
      text,
      power,
    }))
    .filter((c) => may(c.channel, c.unit));
  const sets = [[], ...single.map((c) => [c])];
  for (let n = 1, from = 1; n < most; n++) {
    const end = sets.length;
    for (; from < end; from++) {
      const last = single.indexOf(sets[from].at(-1));
      for (const c of single.slice(last + 1))
        if (sets[from].every((a) => a.channel !== c.channel || a.factor * c.factor < 0))
          sets.push([...sets[from], c]);
    }
  }
  const ofWheels = P.wheelCauses
    .map(([per, power, unit, text]) => ({
      channel: "wheel_speed",
      factor: per * radius ** power,
      unit,
      text,
    }))
    .filter((c) => may(c.channel, c.unit));
  const tried = [null, ...ofWheels].map((wheels) => {
    const per = wheels?.factor ?? 1,
      figures = computeFigures(
        rows,
        d,
        v.map((x) => x / per),
        car,
        tracks,
        per,
      );
    for (const name of without) delete figures[name];
    return { wheels, figures };
  });
  const shown = new Set(tried.flatMap((t) => Object.keys(t.figures).filter((n) => !t.figures[n].nearly)));
  for (const { figures } of tried)
    for (const name of Object.keys(figures)) if (!shown.has(name)) delete figures[name];
  const count = (figures) => Object.keys(figures).length,
    largest = Math.max(...tried.map((t) => count(t.figures)));
  let best = null,
    plain = null;
  for (const { wheels, figures } of tried) {
    for (const causes of sets) {
      const cost =
        computeCost(figures, causes) +
        P.vanished * (largest - count(figures)) +
        causes.reduce((sum, c) => sum + price(c.unit), wheels ? price(wheels.unit) : 0);
      if (!causes.length && !wheels) plain = { cost, figures };
      else if (plain && count(figures) < count(plain.figures)) continue;
      if (!best || cost < best.cost) best = { cost, causes: wheels ? [wheels, ...causes] : causes, figures };
    }
  }
  return count(plain.figures)
    ? { ...best, plain: plain.figures, d, v, front, rear }
    : { causes: [], plain: {}, figures: {}, cost: 0, d, v, front, rear };
}

// Return the min cost if one channel is corrected by any factor, not only by that of a
// unit.
function costFreeFactor(figures) {
  let least = Infinity;
  for (const channel of ["yaw_rate", "accel_y", "accel_x", "steer_angle"]) {
    const turned = applyCauses(figures, [{ channel, factor: Math.E }]);
    let up = 0,
      down = 0;
    for (const [n, f] of Object.entries(figures)) {
      const power = Math.log(Math.abs(turned[n] / f.value));
      if (Math.abs(power) < 1e-9) continue;
      up -= (power * Math.log(Math.abs(f.value))) / f.sd ** 2;
      down += (power / f.sd) ** 2;
    }
    if (down)
      for (const sign of [1, -1])
        least = Math.min(least, computeCost(figures, [{ channel, factor: sign * Math.exp(up / down) }]));
  }
  return PAGE.check.odd + least;
}

// Fit y by least squares on two columns and a constant: {by: coefficients, left: residual
// variance, spread: variance of the first column}. null: too few rows.
function regress(y, a, b, keep) {
  const rows = [...y.keys()].filter((i) => keep(i) && [y, a, b].every((x) => Number.isFinite(x[i])));
  if (rows.length < PAGE.check.fewest) return null;
  const [p, q, z] = [a, b, y].map((x) => {
    const own = rows.map((i) => x[i]),
      mean = computeMean(own);
    return own.map((v) => v - mean);
  });
  const dot = (u, v) => u.reduce((sum, value, i) => sum + value * v[i], 0);
  const pp = dot(p, p),
    qq = dot(q, q),
    pq = dot(p, q),
    pz = dot(p, z),
    qz = dot(q, z),
    det = pp * qq - pq * pq;
  if (!(det > 1e-12 * pp * qq)) return null;
  const by = [(pz * qq - qz * pq) / det, (qz * pp - pz * pq) / det];
  return {
    by,
    left: computeDeviation(z.map((v, i) => v - by[0] * p[i] - by[1] * q[i])) ** 2,
    spread: pp / rows.length,
  };
}

// Return warnings if the IMU is turned about the vertical, or if the wheels of one side
// are taken for an axle (agree._check_turned_imu(), _check_mixed_sides()).
function checkPlacement(d, front, rear) {
  const P = PAGE.check,
    v = front.map((x, i) => 0.5 * (x + rear[i])),
    turn = v.map((x, i) => x * d.yaw_rate[i]),
    short = (x) => formatNumber(x, 2);
  const moving = (i) => Math.abs(v[i]) > P.moving,
    out = [];
  const x = regress(d.accel_x, differentiate(v), turn, moving),
    y = regress(d.accel_y, differentiate(v), turn, moving);
  if (x && y && Math.min(Math.abs(x.by[1]), Math.abs(y.by[0])) >= P.turned && x.by[1] * y.by[0] <= 0) {
    const degrees = ((Math.asin(Math.min(Math.max((x.by[1] - y.by[0]) / 2, -1), 1)) * 180) / Math.PI).toFixed(
      0,
    );
    out.push(
      `check the axes: accel_x contains ${short(x.by[1])} times (speed x yaw_rate), and accel_y ` +
        `contains ${short(y.by[0])} times the rate of change of the speed: the IMU is turned about ` +
        `the vertical by ${degrees} degrees`,
    );
  }
  const slip = differentiate(rear).map((s, i) => s * rear[i]);
  const side = regress(
    front.map((s, i) => s - rear[i]),
    d.yaw_rate,
    slip,
    (i) => Math.abs(front[i]) > P.moving,
  );
  if (side) {
    const by = side.by[0] ** 2 * side.spread,
      share = by / (by + side.left + 1e-12);
    if (share >= P.asideShare && Math.abs(side.by[0]) > P.aside[0] && Math.abs(side.by[0]) < P.aside[1]) {
      out.push(
        `check the wheels: front - rear wheel speed is ${short(side.by[0])} m times yaw_rate, like the ` +
          "difference of left and right wheels: wheel_speed_front or _rear is of one side, or a left " +
          "and a right wheel are one signal",
      );
    }
  }
  return out;
}

// Return warnings if the channels contradict each other, else [] (agree.check_units()).
function checkUnits(rows, car, { ratio, tracks } = {}) {
  const P = PAGE.check;
  if (rows.time.length < 50 || !rows.sampleTime) return [];
  const found = findBestCauses(rows, car, { ratio, tracks }),
    { d, v } = found,
    short = (x) => formatNumber(x, 3);
  const typical = (x) => {
    const fast = Array.from(x, Math.abs).filter((s) => s > P.moving);
    return fast.length ? computeMedian(fast) : 0;
  };
  const out = [],
    a = typical(found.front),
    b = typical(found.rear);
  if (Math.min(a, b) > 0 && !(a / b > 0.8 && a / b < 1.25))
    out.push(
      `check the units: front and rear wheels roll at ${short(a)} and ${short(b)} m/s; ` +
        "wheel_radius_* or one wheel speed is wrong",
    );
  const moving = (i) => Math.abs(v[i]) > P.moving,
    turn = v.map((x, i) => x * d.yaw_rate[i]);
  const x = fitLine(turn, d.accel_x, moving),
    y = fitLine(turn, d.accel_y, moving),
    along = fitLine(differentiate(v), d.accel_y, moving);
  if (
    Math.abs(x.corr) > P.enough.accel_y &&
    Math.abs(y.corr) < 0.5 &&
    (Math.abs(along.corr) > 0.5 || !y.rows || Math.abs(y.corr) < 0.2)
  ) {
    out.push(
      `check the axes: accel_x correlates with speed x yaw_rate (correlation ${x.corr.toFixed(2)}, factor ` +
        `${short(x.slope)}) and accel_y does not (${y.corr.toFixed(2)}): accel_x and accel_y are swapped`,
    );
  }
  if (!out.length) out.push(...checkPlacement(d, found.front, found.rear));
  if (out.length) return out;
  if (found.causes.length && found.cost < costFreeFactor(found.plain)) {
    const after = applyCauses(found.figures, found.causes),
      names = Object.keys(found.plain).filter(
        (n) =>
          n in after &&
          (Math.abs(Math.log(Math.abs(found.plain[n].value / after[n]))) > 0.02 ||
            found.plain[n].value * after[n] < 0),
      );
    const fits = names.every((n) => Math.abs(Math.log(Math.abs(after[n]))) < P.well + 0.05);
    const figures = names.map(
      (n) => `${P.figures[n]} is ${short(found.plain[n].value)}, ${short(after[n])} after`,
    );
    return [
      `check the units: ${fits ? "" : "perhaps "}${found.causes.map((c) => c.text).join(" and ")}; ` +
        `factor ${found.causes.map((c) => short(c.factor)).join(", ")}: ` +
        `${figures.join("; ")} (about 1 is expected)`,
    ];
  }
  const far = (x) => Math.abs(Math.log(Math.abs(x)));
  const braking = (n, f) =>
    n === "steer_angle" && far(f.value) < P.handling ? ", perhaps braking in bends does" : "";
  return Object.entries(found.plain)
    .filter(([, f]) => far(f.value) > P.far + 2 * f.sd)
    .map(
      ([n, f]) =>
        `check the units: ${P.figures[n]} is ${short(f.value)}, but about 1 is expected; ` +
        `no unit that is often mixed up explains it${braking(n, f)}`,
    );
}

// Return wrong units and signs, as causes, of the channels in `open`: those whose unit is
// stated neither by the file nor by the name. The steering angle is ignored, because the
// steering ratio is unknown; log.js estimates it.
function guessUnits(rows, car, open) {
  if (rows.time.length < 50 || !rows.sampleTime) return [];
  const P = PAGE.check,
    may = (channel, unit) => open.has(channel) && (channel !== "wheel_speed" || unit !== "");
  return findBestCauses(rows, car, {
    may,
    price: (unit) => (unit ? P.unsaid : P.price),
    most: 3,
    without: ["steer_angle"],
  }).causes;
}
