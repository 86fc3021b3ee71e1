// drive.js - the second pane: the user drives the simulated car (src/host/simulate.c).

const STEP = 0.01; // s between rows, for which the filter is tuned
const MOST_STEER = 6; // degrees at the road wheels; at 72 km/h, tyres on a dry road then slide
const STEER_RATE = 8; // degrees/s by the arrow keys
const FRAME = 0.05; // s: max time step of the page; a slower page drives slower than real time
const SHOWN = 25; // s shown in the charts
const LONGEST_DRIVE = 600; // s: max duration; the memory holds 60 000 rows
// Name of a road, stiffness relative to a dry road, and friction coefficient, which is
// used only if the box `slide` is checked. Typical values. Without friction the tyres are
// linear. With friction, force / slip decreases with slip, and so does the estimated
// stiffness.
const ROADS = [
  ["dry", 1.0, 1.0],
  ["wet", 0.75, 0.7],
  ["gravel", 0.55, 0.6],
  ["snow", 0.35, 0.3],
];

class DrivePane {
  constructor(lib, desk, adopt) {
    Object.assign(this, { lib, desk, adopt, going: false, keys: new Set(), friction: 1.0 });
    const steer = $("steer");
    steer.min = -MOST_STEER;
    steer.max = MOST_STEER;
    steer.value = 0;
    $("slide").onchange = () => {
      $("slide-hint").hidden = !$("slide").checked;
    };
    for (const id of ["steer", "pedal"])
      $(id).oninput = () => {
        $("auto").checked = false;
        this.outputs();
      };
    $("level").oninput = () => {
      this.road(null);
      this.outputs();
    };
    $("noise").oninput = () => this.outputs();
    $("go").onclick = () => this.toggle();
    $("again").onclick = () => this.begin();
    $("keep").onclick = () => this.keep();
    $("roads").append(
      ...ROADS.map(([name, level, friction]) =>
        make("button", {
          type: "button",
          textContent: name,
          onclick: () => {
            this.road([name, level, friction]);
            this.outputs();
          },
        }),
      ),
    );
    document.addEventListener("keydown", (e) => this.key(e, true));
    document.addEventListener("keyup", (e) => this.key(e, false));
    this.chart = new Chart($("drive-chart"), {
      label:
        "Stiffness with its 95 % interval beside the truth, the sideslip angle, and the " +
        "probabilities of what happened",
      live: SHOWN,
      time: () => ({ t: this.t, n: this.n }),
      panels: this.panels(),
    });
    new ResizeObserver(() => this.look()).observe($("view"));
    this.road(ROADS[0]);
    this.begin();
  }

  panels() {
    const all = makePanels(
      this.lib,
      () => this.columns,
      (s) => this.columns[`true_${s}`],
      (s, i) => this.reasonOf(this.columns[`${s}_reason`][i]),
      92,
    );
    const angle = {
      title: "Sideslip angle",
      unit: "deg",
      scale: 180 / Math.PI,
      height: 70,
      zero: true,
      lines: [
        { name: "truth", values: () => this.columns.true_sideslip, color: "truth", dash: [5, 4], width: 1.4 },
        { name: "estimate", values: () => this.columns.sideslip, color: "est" },
      ],
    };
    return [...all.slice(0, 3), angle, all[3]];
  }

  reasonOf(code) {
    return this.lib.tables.reason.find((f) => f.offset === code)?.name ?? "row refused";
  }

  // Reset car and filter; the filter starts at the nominal stiffness.
  begin() {
    const { desk } = this,
      speed = 20;
    desk.exact();
    desk.set("driven_axle", DRIVEN.front);
    desk.set("sample_time", STEP);
    const seed = Number($("seed").value),
      f = this.lib.field("simConfig", "seed");
    if (!(Number.isInteger(seed) && seed >= f.lo && seed <= f.hi)) {
      $("drive-state").textContent = `seed: allowed are whole numbers in ${f.lo} .. ${f.hi}`;
      return;
    }
    desk.set("seed", seed, "simConfig");
    desk.set("noise", Number($("noise").value), "simConfig");
    desk.set("speed", speed, "simConfig");
    desk.set("hold_inputs", 0, "simConfig");
    desk.simStart();
    desk.start();
    Object.assign(this, {
      n: 0,
      t: new Float64Array(1024),
      columns: {},
      pose: { x: 0, y: 0, heading: 0 },
      path: [],
      angle: 0,
      owed: 0,
    });
    const names = [
      "sideslip",
      "true_sideslip",
      "vel_x",
      "change_age",
      "change_kind",
      "change_probability",
      ...STIFFNESS.map((s) => `change_${s}`),
      ...REGIMES.map(([name]) => name),
      ...STIFFNESS.flatMap((s) => [s, `${s}_sd`, `${s}_valid`, `${s}_reason`, `true_${s}`]),
      ...this.lib.channels.map((c) => `row_${c.name}`),
    ];
    for (const name of names) this.columns[name] = new Float64Array(1024);
    this.row();
    this.outputs();
    this.show();
    $("keep").disabled = true;
  }

  toggle() {
    this.going = !this.going;
    $("go").textContent = this.going ? "Pause" : "Go on";
    this.since = null;
    if (this.going) requestAnimationFrame((now) => this.frame(now));
  }

  frame(now) {
    if (!this.going) return;
    this.owed += this.since === null ? STEP : Math.min((now - this.since) / 1000, FRAME);
    this.since = now;
    for (; this.owed >= STEP && this.going; this.owed -= STEP) this.row();
    this.show();
    if (this.going) requestAnimationFrame((next) => this.frame(next));
  }

  // Return the inputs of the driver, and the speed: {steer [rad], force [N], v [m/s]}.
  driver() {
    const t = this.n * STEP,
      car = this.desk,
      v = this.n ? car.sim("true_vel_x") : 20;
    if ($("auto").checked) {
      const grip = Number($("level").value) < 0.5 ? 0.5 : 1; // less on a slippery road
      $("steer").value =
        (180 / Math.PI) * 0.03 * grip * Math.sin(2 * Math.PI * 0.4 * t) * (0.6 + 0.4 * Math.sin(0.7 * t));
      // the speed varies: without force there is no slip
      const target = 20 + 2.5 * Math.sin((2 * Math.PI * t) / 9);
      $("pedal").value = Math.max(-1, Math.min(1, (PAGE.rules.speedGain * (target - v)) / 4));
    } else {
      const hold = (key) => this.keys.has(key);
      if (hold("ArrowLeft") || hold("ArrowRight"))
        $("steer").value = Number($("steer").value) + (hold("ArrowLeft") ? 1 : -1) * STEER_RATE * STEP;
      else if (this.steered) $("steer").value = Number($("steer").value) * (1 - 3 * STEP); // self-aligning
      if (hold("ArrowUp") || hold("ArrowDown")) $("pedal").value = hold("ArrowUp") ? 0.6 : -0.7;
      else if (this.pedalled) $("pedal").value = 0;
    }
    const pedal = Number($("pedal").value);
    return {
      steer: (Number($("steer").value) * Math.PI) / 180,
      force: car.get("mass") * (pedal > 0 ? 4 * pedal : 8 * pedal),
      v,
    };
  }

  key(e, down) {
    if (!e.key.startsWith("Arrow") || $("pane-drive").hidden || e.altKey || e.ctrlKey || e.metaKey) return;
    // other controls use the arrow keys themselves
    if (e.target.matches?.("select, input:not(#steer, #pedal), [role=tab]")) return;
    e.preventDefault();
    if (!down) {
      this.keys.delete(e.key);
      return;
    }
    this.keys.add(e.key);
    $("auto").checked = false;
    if (e.key === "ArrowLeft" || e.key === "ArrowRight") this.steered = true;
    else this.pedalled = true;
    if (!this.going) this.toggle();
  }

  road(which) {
    if (which) {
      $("level").value = which[1];
      this.friction = which[2];
    }
    for (const b of $("roads").children)
      b.setAttribute("aria-pressed", String(which !== null && b.textContent === which[0]));
  }

  // Make one row: driver, car, log, filter.
  row() {
    const { desk } = this,
      d = this.driver(),
      level = Number($("level").value);
    if (this.n * STEP >= LONGEST_DRIVE) {
      if (this.going) this.toggle();
      $("drive-state").textContent = `A drive on this page lasts at most ${LONGEST_DRIVE} s: start over.`;
      return;
    }
    const set = (name, value) => desk.set(name, value, "simInput");
    set("dt", STEP);
    set("steer_angle", d.steer);
    const drive = Math.max(d.force, 0),
      brake = Math.max(-d.force, 0),
      stand = d.v < 0.5 && d.force <= 0 ? PAGE.rules.holdTorque : 0;
    set("wheel_torque_front", drive * desk.get("wheel_radius_front"));
    set("wheel_torque_rear", 0);
    set("brake_torque_front", brake * PAGE.rules.brakeFront * desk.get("wheel_radius_front") + stand);
    set("brake_torque_rear", brake * (1 - PAGE.rules.brakeFront) * desk.get("wheel_radius_rear") + stand);
    set("road_level", level);
    set("road_friction", $("slide").checked ? this.friction : 0);
    desk.simStep();
    desk.step(1);
    this.angle = d.steer;
    const i = this.n++;
    if (i >= this.t.length) this.grow();
    this.t[i] = i * STEP;
    const c = this.columns,
      vx = desk.sim("true_vel_x"),
      vy = desk.sim("true_vel_y");
    for (const s of STIFFNESS) {
      const nominal = desk.get(NOMINAL[s]),
        reason = desk.output(`${s}_valid`);
      c[s][i] = desk.output(s) * nominal;
      c[`${s}_sd`][i] = desk.output(`${s}_sd`) * nominal;
      c[`${s}_valid`][i] = reason === 0 ? 1 : 0;
      c[`${s}_reason`][i] = reason;
      c[`true_${s}`][i] = desk.sim(`true_${s}`) * nominal;
      c[`change_${s}`][i] = desk.output(`change_${s}`);
    }
    for (const name of [
      "sideslip",
      "vel_x",
      "change_age",
      "change_kind",
      "change_probability",
      ...REGIMES.map(([n]) => n),
    ])
      c[name][i] = desk.output(name);
    c.true_sideslip[i] = vx === 0 && vy === 0 ? 0 : Math.atan2(vy, vx);
    for (const f of this.lib.channels) c[`row_${f.name}`][i] = desk.sim(f.name);
    const p = this.pose; // pose of the car in the picture
    p.x += STEP * (vx * Math.cos(p.heading) - vy * Math.sin(p.heading));
    p.y += STEP * (vx * Math.sin(p.heading) + vy * Math.cos(p.heading));
    p.heading += STEP * desk.sim("true_yaw_rate");
    if (i % 5 === 0) {
      this.path.push([p.x, p.y, level]);
      if (this.path.length > 600) this.path.shift();
    }
  }

  grow() {
    const longer = (x) => {
      const y = new Float64Array(2 * x.length);
      y.set(x);
      return y;
    };
    this.t = longer(this.t);
    for (const name of Object.keys(this.columns)) this.columns[name] = longer(this.columns[name]);
  }

  at(name, i = this.n - 1) {
    const value = this.columns[name][i];
    return name.endsWith("_reason") ? this.reasonOf(value) : value;
  }

  outputs() {
    $("steer-out").textContent = `${tidy(Number($("steer").value), 2)}°`;
    const pedal = Number($("pedal").value);
    $("pedal-out").textContent =
      pedal > 0
        ? `drive ${Math.round(100 * pedal)} %`
        : pedal < 0
          ? `brake ${Math.round(-100 * pedal)} %`
          : "none";
    $("level-out").textContent = `× ${tidy(Number($("level").value), 3)}`;
    $("noise-out").textContent = `× ${tidy(Number($("noise").value), 2)}`;
  }

  show() {
    if (!this.n) return;
    this.outputs();
    this.look();
    this.chart.later();
    const now = performance.now();
    if (now - (this.said ?? -1e9) < 150 && this.going) return;
    this.said = now;
    showCards(
      $("drive-cards"),
      (name) => this.at(name),
      (s) => this.at(`true_${s}`),
      null,
    );
    const time = this.t[this.n - 1];
    $("drive-state").textContent =
      this.n > 1 ? `${time.toFixed(1)} s. ${describeChange((name) => this.at(name), time)}` : "Press Start.";
    $("keep").disabled = this.n < 200;
  }

  // Draw the car from above, front up, and its path in the colours of the roads.
  look() {
    const view = $("view"),
      ratio = window.devicePixelRatio || 1,
      wide = view.clientWidth,
      tall = view.clientHeight;
    if (!wide || !this.n) return;
    if (view.width !== Math.round(wide * ratio) || view.height !== Math.round(tall * ratio)) {
      view.width = Math.round(wide * ratio);
      view.height = Math.round(tall * ratio);
    }
    const g = view.getContext("2d"),
      style = getComputedStyle(view),
      ink = (n) => style.getPropertyValue(`--${n}`).trim();
    const scale = Math.max(8, tall / 34),
      p = this.pose,
      c = this.desk;
    g.setTransform(ratio, 0, 0, ratio, 0, 0);
    g.clearRect(0, 0, wide, tall);
    g.save();
    g.translate(wide / 2, tall * 0.68);
    g.scale(scale, -scale); // m, y up
    g.rotate(Math.PI / 2 - p.heading);
    g.translate(-p.x, -p.y);
    const far = Math.hypot(wide, tall) / scale,
      grid = 10;
    g.strokeStyle = ink("line");
    g.lineWidth = 1 / scale;
    g.beginPath();
    for (let k = Math.floor((p.x - far) / grid); k <= (p.x + far) / grid; k++) {
      g.moveTo(k * grid, p.y - far);
      g.lineTo(k * grid, p.y + far);
    }
    for (let k = Math.floor((p.y - far) / grid); k <= (p.y + far) / grid; k++) {
      g.moveTo(p.x - far, k * grid);
      g.lineTo(p.x + far, k * grid);
    }
    g.stroke();
    g.lineWidth = 0.5;
    g.lineCap = "round";
    for (let i = 1; i < this.path.length; i++) {
      const [x, y, level] = this.path[i];
      g.strokeStyle =
        level >= 0.9 ? ink("good") : level >= 0.6 ? ink("est") : level >= 0.45 ? ink("warn") : ink("bad");
      g.beginPath();
      g.moveTo(this.path[i - 1][0], this.path[i - 1][1]);
      g.lineTo(x, y);
      g.stroke();
    }
    g.translate(p.x, p.y);
    g.rotate(p.heading);
    const lf = c.get("lf"),
      lr = c.get("lr");
    g.fillStyle = ink("soft");
    const wheel = (x, y, angle) => {
      g.save();
      g.translate(x, y);
      g.rotate(angle);
      g.fillStyle = ink("ink");
      g.fillRect(-0.35, -0.13, 0.7, 0.26);
      g.restore();
    };
    g.globalAlpha = 0.9;
    g.beginPath();
    g.roundRect(-lr - 0.9, -0.92, lf + lr + 1.8, 1.84, 0.5);
    g.fill();
    g.globalAlpha = 1;
    for (const side of [-0.8, 0.8]) {
      wheel(lf, side, this.angle);
      wheel(-lr, side, 0);
    }
    const arrow = (angle, color, dash) => {
      // velocity of the centre of gravity
      const long = 3 + 0.25 * Math.abs(this.desk.sim("true_vel_x"));
      g.strokeStyle = ink(color);
      g.lineWidth = 0.22;
      g.setLineDash(dash);
      g.beginPath();
      g.moveTo(0, 0);
      g.lineTo(long * Math.cos(angle), long * Math.sin(angle));
      g.stroke();
      g.setLineDash([]);
    };
    arrow(this.at("true_sideslip"), "truth", [0.6, 0.5]);
    arrow(this.at("sideslip"), "est", []);
    g.restore();
    g.font = "600 14px system-ui, sans-serif";
    g.fillStyle = ink("ink");
    g.fillText(`${Math.round(3.6 * this.desk.sim("true_vel_x"))} km/h`, 10, 22);
    g.font = "12px system-ui, sans-serif";
    g.fillText(`lateral ${tidy(this.desk.sim("true_accel_y"), 2)} m/s²`, 10, 40);
    g.fillStyle = ink("soft");
    g.textAlign = "right";
    g.fillText("direction of motion: solid estimate, dashed truth", wide - 10, tall - 10);
    g.textAlign = "left";
  }

  // Hand the rows of this drive to the other pane.
  keep() {
    if (this.going) this.toggle();
    const n = this.n,
      part = (x) => x.slice(0, n);
    const rows = { name: "drive", time: part(this.t), data: {}, truth: {}, notes: [], sampleTime: null };
    for (const f of this.lib.channels) rows.data[f.name] = part(this.columns[`row_${f.name}`]);
    for (const s of STIFFNESS) rows.truth[s] = part(this.columns[`true_${s}`]);
    rows.sampleTime = computeMedian(computeSteps(rows.time));
    this.adopt(rows, this.desk.settings());
  }
}
