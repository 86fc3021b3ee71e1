// log.js - the first pane: a file, its channels, the car, the estimate.

const $ = (id) => document.getElementById(id);
const make = (tag, properties = {}, ...children) => {
  const node = Object.assign(document.createElement(tag), properties);
  node.append(...children);
  return node;
};
const capitalize = (text) => text.charAt(0).toUpperCase() + text.slice(1);
const NAMES = Object.fromEntries(Object.entries(PAGE.names).map(([s, name]) => [s, capitalize(name)]));
const SHORT = { cx_front: "Cx front", cy_front: "Cy front", cy_rear: "Cy rear" };
const REGIMES = [
  ["p_steady", "tyres as before", "good"],
  ["p_changed", "another road", "est"],
  ["p_axle", "one axle changed", "est"],
  ["p_fault", "a channel at fault", "bad"],
  ["p_sliding", "wheels lock or spin", "warn"],
  ["p_restarted", "started over", "warn"],
];
const CHANGES = [
  "",
  "the road changed (all tyres)",
  "the front axle changed",
  "the rear axle changed",
  "the filter started over",
];

// Note above an estimate that differs from that of the command
const ITSELF =
  "This estimate assumes an ordinary car of the stated mass and axle distances. " +
  "`tselab estimate` and Python first calibrate the car on the log: their estimates are more certain " +
  "and differ from these by some percent. With --no-calibrate, they are equal to these.";

// Return the panels of a chart of estimates. columns() returns the table, which grows, as
// name -> values. truth(s): true values of a stiffness, or null.
function makePanels(lib, columns, truth, reason, height) {
  const unit = (s) => `k${lib.field("config", NOMINAL[s]).unit}`;
  const panels = ["cy_front", "cy_rear", "cx_front"].map((s) => ({
    title: NAMES[s],
    short: SHORT[s],
    unit: unit(s),
    scale: 1e-3,
    height,
    lines: [
      { name: "truth", values: () => truth(s), color: "truth", dash: [5, 4], width: 1.4 },
      { name: "estimate", values: () => columns()[s], color: "est", band: true },
    ],
    band: {
      mean: () => columns()[s] ?? new Float64Array(0),
      sd: () => columns()[`${s}_sd`] ?? new Float64Array(0),
    },
    strip: { valid: () => columns()[`${s}_valid`], reason: (i) => reason(s, i) },
  }));
  return [
    ...panels,
    {
      title: "Probability of what happened",
      heat: REGIMES.map(([name, text, color]) => ({ name: text, values: () => columns()[name], color })),
    },
  ];
}

// Show the estimates of the last row, one card per stiffness.
function showCards(host, at, truth, share, contradicted = false) {
  host.replaceChildren(
    ...["cy_front", "cy_rear", "cx_front"].map((s) => {
      const valid = at(`${s}_valid`) && !contradicted,
        card = make("div", { className: valid ? "valid" : "" });
      const half = BAND * at(`${s}_sd`),
        unit = s === "cx_front" ? "kN" : "kN/rad";
      const known = truth(s);
      card.append(
        make("b", { textContent: NAMES[s] }),
        make("strong", { textContent: `${tidy(at(s) / 1000, 4)} ± ${tidy(half / 1000, 2)} ${unit}` }),
        make("span", {
          textContent: contradicted
            ? "not usable: the channels contradict each other"
            : (valid ? "valid" : `not valid: ${at(`${s}_reason`)}`) +
              (share ? `; valid in ${share(s)} of the rows` : ""),
        }),
      );
      if (known !== null)
        card.append(make("span", { textContent: `truth ${tidy(known / 1000, 4)} ${unit}` }));
      return card;
    }),
  );
}

// Return the last change in a sentence.
function describeChange(at, time) {
  const kind = at("change_kind");
  if (!kind) return "No change of the tyres or the road was found so far.";
  const ratio = ["cx_front", "cy_front", "cy_rear"]
    .map((s) => `${SHORT[s]} × ${tidy(at(`change_${s}`), 3)}`)
    .join(", ");
  return (
    `Last change: ${CHANGES[kind] ?? `kind ${kind}`} at ${tidy(time - at("change_age"), 5)} s, ` +
    `probability ${Math.round(100 * at("change_probability"))} %: ${ratio}.`
  );
}

class LogPane {
  constructor(lib, desk) {
    Object.assign(this, {
      lib,
      desk,
      file: null,
      rows: null,
      table: null,
      running: null,
      stopped: false,
      against: [],
      known: {},
      ratioSd: null,
      plainRatioSd: null,
    });
    this.said = new Map(); // settings of the user or the vehicle file; rules do not change them
    this.driven = DRIVEN.front;
    $("formats").textContent = PAGE.parquet ? "CSV or Parquet" : "CSV";
    $("file").accept = PAGE.parquet ? ".csv,.txt,.tsv,.dat,.asc,.parquet,.pq" : ".csv,.txt,.tsv,.dat,.asc";
    $("file").onchange = () => $("file").files[0] && this.open($("file").files[0]);
    const drop = $("drop");
    for (const [event, over] of [
      ["dragenter", true],
      ["dragover", true],
      ["dragleave", false],
      ["drop", false],
    ]) {
      document.addEventListener(event, (e) => {
        e.preventDefault();
        drop.classList.toggle("over", over);
      });
    }
    document.addEventListener("drop", (e) => {
      const f = e.dataTransfer?.files[0];
      if (f) {
        choose("log");
        if (/\.toml$/i.test(f.name)) this.openCar(f);
        else this.open(f);
      }
    });
    $("example").onclick = () => this.example();
    $("run").onclick = () => this.run();
    $("stop").onclick = () => {
      this.stopped = true;
    };
    $("known").onchange = () => {
      this.forget(this.lib.groups[1]);
      this.tell($("known").value === "1");
      this.show();
    };
    $("rules").onclick = () => {
      this.forget(this.lib.groups[0].filter((n) => /stiffness|inertia/.test(n)));
      this.byRule();
      this.show();
    };
    $("save-est").onclick = () =>
      this.guarded(async () => save(await formatCsv(this.table, makeBreather()), `${this.stem()}.est.csv`));
    $("save-log").onclick = () => save([formatLog(this.rows, lib)], "log.csv");
    $("save-car").onclick = () => save([formatVehicle(this.used, "the car of the page")], "vehicle.toml");
    if (PAGE.toml) {
      $("load-car").hidden = false;
      $("car-file").onchange = () => $("car-file").files[0] && this.openCar($("car-file").files[0]);
    }
    $("known").value = "1";
    this.settings();
    if (innerWidth < 760) $("vehicle-more").open = false; // so that results are not far down on a phone
    this.chart = new Chart($("chart"), {
      label: "Stiffness with its 95 % interval, validity and the probabilities of what happened, over time",
      time: () => (this.table ? { t: this.table.time, n: this.table.rows } : { t: [], n: 0 }),
      panels: makePanels(
        lib,
        () => this.table?.columns ?? {},
        (s) => this.rows?.truth?.[s] ?? null,
        (s, i) => this.table.reasonText(this.table.columns[`${s}_reason`][i]),
        130,
      ),
    });
  }

  stem() {
    return this.rows.name.replace(/\.[^.]*$/, "").replace(/\W+/g, "-");
  }

  say(text) {
    $("state").textContent = text;
  }

  complain(error, place = "log-wrong") {
    $(place).textContent = error
      ? error instanceof Wrong || error instanceof Refused
        ? error.message
        : `this page failed: ${error.message}`
      : "";
    if (error && !(error instanceof Wrong || error instanceof Refused)) console.error(error);
  }

  async guarded(act, place = "log-wrong") {
    this.complain(null);
    this.complain(null, "car-wrong");
    try {
      await act();
      return true;
    } catch (error) {
      this.complain(error, error instanceof Refused ? "car-wrong" : place);
      this.say("");
      return false;
    }
  }

  // ---- the car

  settings() {
    this.fields = new Map();
    this.lib.groups.forEach((names, k) => {
      const host = $(["vehicle", "uncertainty", "sensors"][k]);
      for (const name of names) {
        const f = this.lib.field("config", name),
          id = `set-${name}`;
        const input = make("input", {
          type: "number",
          id,
          min: f.lo,
          max: f.hi,
          step: "any",
          required: !mayBeUnset(f),
        });
        input.setAttribute("aria-describedby", `${id}-text`);
        input.onchange = () => {
          if (!this.read(name)) return;
          if (isUnset(f, this.desk.get(name))) this.said.delete(name);
          else this.said.set(name, this.desk.get(name));
          this.hint();
        };
        this.fields.set(name, input);
        host.append(
          make(
            "label",
            { htmlFor: id },
            make("span", { textContent: name.replaceAll("_", " ") }),
            make(
              "span",
              { className: "value" },
              input,
              make("i", { textContent: f.unit === "1" ? "" : f.unit }),
            ),
            make("small", { id: `${id}-text`, textContent: `${f.text}; ${formatRange(f)}` }),
          ),
        );
      }
    });
    this.show();
  }

  show() {
    for (const [name, input] of this.fields) {
      const value = this.desk.get(name);
      input.value = isUnset(this.lib.field("config", name), value) ? "" : String(value);
      input.setCustomValidity("");
      input.removeAttribute("aria-invalid");
    }
    this.hint();
    this.complain(null, "car-wrong");
  }

  // In the empty field of an unset setting, show the value that follows from mass, lf and
  // lr.
  hint() {
    const made = this.car();
    for (const [name, input] of this.fields) {
      if (mayBeUnset(this.lib.field("config", name)))
        input.placeholder = name === "mass" ? "not known" : formatNumber(made[name]);
    }
  }

  // Read a setting from its field; return false if it is refused.
  read(name) {
    const input = this.fields.get(name),
      f = this.lib.field("config", name),
      value = input.value === "" ? (mayBeUnset(f) ? f.def : NaN) : Number(input.value);
    const fine = (value >= f.lo && value <= f.hi) || isUnset(f, value);
    input.setCustomValidity(fine ? "" : `allowed: ${formatRange(f)}`);
    if (fine) input.removeAttribute("aria-invalid");
    else input.setAttribute("aria-invalid", "true");
    this.complain(
      fine
        ? null
        : new Refused(
            `${name.replaceAll("_", " ")}: ${input.value === "" ? "is empty" : formatNumber(value)}; ` +
              `allowed: ${formatRange(f)} (${f.text})`,
            name,
          ),
      "car-wrong",
    );
    if (fine) this.desk.set(name, value);
    else input.closest("details")?.setAttribute("open", "");
    return fine;
  }

  car() {
    return this.desk.completed();
  }

  // Set how well the car is known: exactly, or uncalibrated with ordinary sensors.
  tell(uncalibrated) {
    $("known").value = uncalibrated ? "1" : "0";
    this.plainRatioSd = null; // steer_ratio_sd before loosen()
    const before = this.desk.settings(),
      [vehicle, , sensors] = this.lib.groups;
    if (uncalibrated) this.desk.defaults();
    else this.desk.exact();
    this.put(uncalibrated ? vehicle : [...vehicle, ...sensors], before);
    this.repeat();
  }

  put(names, from) {
    for (const name of names) this.desk.set(name, from[name]);
  }

  // Set the settings that the page does not show. If any uncertainty is not 0, they are
  // those of an ordinary car (make_filter_values() in scripts/tse/car/vehicle.py).
  prior() {
    const shown = this.desk.settings(),
      names = this.lib.groups.flat();
    if (this.lib.groups[1].some((name) => shown[name] !== 0)) this.desk.defaults();
    else this.desk.exact();
    this.put(names, shown);
    this.desk.set("driven_axle", this.driven);
  }

  forget(names) {
    for (const name of names) this.said.delete(name);
  }

  // Restore the settings of the user after a rule.
  repeat() {
    for (const [name, value] of this.said) this.desk.set(name, value);
  }

  // Set stiffness and inertia to those of an ordinary car of this mass, lf and lr.
  byRule() {
    for (const name of this.lib.groups[0].filter((n) => /_stiffness_|^yaw_inertia$/.test(n)))
      this.desk.set(name, 0);
    this.repeat();
  }

  openCar(file) {
    return this.guarded(async () => {
      if (!PAGE.toml)
        throw new Wrong(
          `${file.name}: this copy of the page cannot read vehicle files: it was built without npm. ` +
            "Use the command tselab",
        );
      let said;
      try {
        said = tomlReader.parse(await file.text());
      } catch (error) {
        throw new Wrong(`${file.name}: is not TOML: ${error.message.split("\n")[0]}`);
      }
      const [vehicle, known, sensors] = this.lib.groups,
        missing = PAGE.rules.required.filter((n) => !(n in said));
      if (missing.length)
        throw new Wrong(
          `${file.name}: key ${missing.join(", ")} is missing (allowed: ` +
            `${missing.map((n) => `${n}: ${formatRange(this.lib.field("config", n))}`).join("; ")})`,
        );
      const values = {},
        unknown = [];
      for (const [table, names, where] of [
        [said, vehicle, ""],
        [said.uncertainty ?? {}, known, "uncertainty."],
        [said.sensors ?? {}, sensors, "sensors."],
      ]) {
        for (const [key, value] of Object.entries(table)) {
          if (names.includes(key)) {
            const f = this.lib.field("config", key);
            if (!(Number(value) >= f.lo && Number(value) <= f.hi))
              throw new Wrong(
                `${file.name}: key ${where}${key} = ${value} is refused; allowed: ${formatRange(f)} ` +
                  `(${f.text})`,
              );
            values[key] = Number(value);
          } else if (where || !(PAGE.rules.descriptive.includes(key) || typeof value === "object"))
            unknown.push(where + key);
        }
      }
      if (unknown.length) throw new Wrong(`${file.name}: key ${unknown.slice(0, 3).join(", ")} is not known`);
      const heavy = ["latency", "effects", "formula"].filter((n) => Object.keys(said[n] ?? {}).length);
      if (heavy.length)
        throw new Wrong(`${file.name}: this page cannot use [${heavy[0]}]: use the command tselab`);
      const driven = said.driven_axle ?? "front";
      if (!(driven in DRIVEN))
        throw new Wrong(`${file.name}: key driven_axle: ${driven} is not known; allowed: front, rear, both`);
      this.driven = DRIVEN[driven];
      this.said = new Map(Object.entries(values));
      this.tell(true);
      if (this.file) this.loosen(this.ratioSd);
      this.byRule();
      this.show();
      this.known = { ratio: said.steering_ratio, tracks: { front: said.track_front, rear: said.track_rear } };
      this.say(`${file.name}: ${Object.keys(values).length} settings${this.rows ? "; estimate again" : ""}.`);
    }, "car-wrong");
  }

  // ---- the log

  example() {
    return this.guarded(async () => {
      await this.halt();
      this.file = null;
      $("mapping").hidden = true;
      this.said.clear();
      this.driven = DRIVEN.front;
      const rows = makeExample(this.desk);
      $("known").value = "0";
      this.show();
      await this.run(rows);
    });
  }

  async open(file) {
    await this.halt();
    this.file = this.ratioSd = null;
    $("found").hidden = true; // these are results of the previous log
    $("run").disabled = true;
    $("mapping").hidden = true;
    this.notes([]);
    await this.guarded(async () => {
      this.say(`reading ${file.name}`);
      const bytes = new Uint8Array(await file.arrayBuffer()),
        breathe = makeBreather((what, share) => this.say(`${what}: ${Math.round(100 * share)} %`));
      const isParquet = bytes.length > 8 && String.fromCharCode(...bytes.subarray(0, 4)) === "PAR1";
      const table = isParquet
        ? await readParquet(file.name, bytes, breathe)
        : await readText(file.name, bytes, breathe);
      this.file = { table, ...propose(table, this.lib) };
      this.desk.defaults(); // the last car may be that of the simulator
      this.tell(true);
      this.byRule();
      this.mapping();
      $("run").disabled = false;
      this.say("");
      const said = this.units();
      this.guess();
      if (said) $("map-hint").prepend(`${said} `);
      const rows = this.checked();
      this.show();
      this.notes([...checkUnits(rows, this.car(), this.known), ...rows.notes]);
      if (this.file.own) await this.run(rows);
      else this.say("Are the channels right? Then estimate.");
    });
  }

  checked() {
    return checkRows(this.file.table, this.file.map, this.car(), this.lib);
  }

  // Guess missing units and signs from the rows, and set them. Return them in words, or
  // "".
  units() {
    const open = listOpenChannels(this.file);
    if (!open.size) return "";
    let causes;
    try {
      const map = structuredClone(this.file.map);
      map.steer_angle.ratio = 1000; // unknown; any value inside the range
      causes = guessUnits(checkRows(this.file.table, map, this.car(), this.lib), this.car(), open);
    } catch {
      return "";
    } // reported when the rows are checked
    const said = [];
    for (const c of causes) {
      for (const channel of CHANNELS.filter(
        (n) => (isAxle(n) ? "wheel_speed" : n) === c.channel && this.file.map[n].column,
      )) {
        if (c.unit) this.file.map[channel].unit = c.unit;
        else this.file.map[channel].sign = -1;
      }
      said.push(c.text.replace(/ \(.*/, ""));
    }
    return said.length ? `Guessed from the rows: ${said.join("; ")}.` : "";
  }

  // Set the relative sd of a guessed steering ratio; null: the user stated the ratio.
  loosen(sd) {
    this.ratioSd = sd;
    if (this.said.has("steer_ratio_sd")) return;
    const f = this.lib.field("config", "steer_ratio_sd");
    this.plainRatioSd ??= this.desk.get(f.name);
    this.desk.set(f.name, Math.min(Math.max(sd ?? 0, this.plainRatioSd), f.hi));
  }

  // Guess sign and ratio of the steering from the rows, and set them.
  guess() {
    $("map-hint").textContent = "";
    if (this.file.own || !this.file.guessed.includes("steer_angle")) return;
    const map = structuredClone(this.file.map);
    map.steer_angle.ratio = 1000; // unknown; any value inside the range
    let found;
    try {
      found = estimateSteeringGain(checkRows(this.file.table, map, this.car(), this.lib), this.car());
    } catch {
      return;
    } // reported when the rows are checked
    if (found === null) return;
    const m = this.file.map.steer_angle,
      ratio = Math.abs(found.gain) * map.steer_angle.ratio,
      wheel = ratio > 5; // else the column is the angle of the road wheels, with the ratio 1
    if (found.gain < 0) m.sign = -1;
    if (wheel) m.ratio = Number(ratio.toPrecision(3));
    const sd = Math.hypot(found.sd, PAGE.check.sd.steer_angle);
    if (wheel) this.loosen(sd);
    const what = wheel
      ? `the column is the angle of the steering wheel, ratio about ${m.ratio} (± ${Math.round(196 * sd)} %)`
      : "the column is the angle of the road wheels";
    $("map-hint").textContent =
      `Guessed from the rows: ${what}` +
      (found.gain < 0 ? ", positive to the right; the sign is changed." : ".") +
      (wheel ? " State the ratio if you know it: a wrong ratio makes the stiffness wrong." : "");
    this.mapping();
  }

  mapping() {
    const { table, map } = this.file,
      host = $("map"),
      names = table.columns.map((c) => c.name);
    $("mapping").hidden = false;
    $("log-name").textContent = `${table.name} (${table.line.length} rows, ${names.length} columns)`;
    host.replaceChildren(
      ...["channel", "column", "right wheel", "unit", "sign"].map((text) =>
        make("span", { className: "head", textContent: text }),
      ),
    );
    for (const channel of CHANNELS) {
      const m = map[channel],
        axle = isAxle(channel),
        id = `map-${channel}`;
      const text = channel === "time" ? "time of the row" : this.lib.field("input", channel).text;
      const choice = (label, value, options, act) => {
        const s = make(
          "select",
          {
            onchange: () => {
              act(s.value);
              this.remapped();
            },
          },
          ...options.map(([v, t]) => make("option", { value: v, textContent: t, selected: v === value })),
        );
        s.setAttribute("aria-label", `${channel}: ${label}`);
        return s;
      };
      const columns = [["", "(none)"], ...names.map((n) => [n, n])];
      const column = choice("column", m.column, columns, (v) => {
        m.column = v;
        const c = table.columns.find((x) => x.name === v);
        if (c) m.unit = chooseUnit(channel, c, this.lib);
      });
      column.id = id;
      column.className = axle ? "" : "wide";
      host.append(
        make(
          "label",
          { htmlFor: id },
          make("b", { textContent: channel.replaceAll("_", " ") }),
          make("span", { textContent: text }),
        ),
        column,
      );
      if (axle)
        host.append(
          choice(
            "right wheel",
            m.other,
            [["", "(none: one column per axle)"], ...names.map((n) => [n, n])],
            (v) => {
              m.other = v;
            },
          ),
        );
      host.append(
        choice(
          "unit",
          m.unit,
          listUnits(channel).map((u) => [u, u]),
          (v) => {
            m.unit = v;
          },
        ),
      );
      const extra = make("span", { className: "extra" });
      if (channel !== "time")
        extra.append(
          choice(
            "sign",
            String(m.sign),
            [
              ["1", "+"],
              ["-1", "−"],
            ],
            (v) => {
              m.sign = Number(v);
            },
          ),
        );
      if (channel === "steer_angle") {
        const ratio = make("input", {
          type: "number",
          min: 0.01,
          step: "any",
          value: m.ratio,
          title:
            "steering ratio: angle of the steering wheel / angle of the road wheels; 1: the column is " +
            "the angle of the road wheels",
        });
        ratio.setAttribute("aria-label", "steering ratio");
        ratio.onchange = () => {
          m.ratio = Number(ratio.value);
          this.loosen(null);
          this.remapped();
        };
        extra.append(make("span", { textContent: "ratio", className: "hint" }), ratio);
      }
      host.append(extra);
    }
  }

  remapped() {
    this.mapping();
    this.guarded(() => {
      const rows = this.checked();
      this.show();
      this.notes([...checkUnits(rows, this.car(), this.known), ...rows.notes]);
      this.say("Are the channels right? Then estimate.");
    });
  }

  notes(notes) {
    $("log-notes").replaceChildren(...notes.map((n) => make("li", { textContent: n })));
  }

  // ---- the estimate

  async halt() {
    this.stopped = true;
    await this.running;
  }

  async run(given = null) {
    await this.halt();
    for (const name of this.fields.keys()) {
      if (this.read(name)) continue;
      this.say(`Not estimated: ${$("car-wrong").textContent}`);
      this.fields.get(name).focus(); // also scrolls it into view
      return;
    }
    const ok = this.guarded(async () => {
      const rows = given ?? (this.file ? this.checked() : repeatRows(this));
      this.prior();
      const sampling = [...setSampling(this.desk, rows.sampleTime), ...setWheels(this.desk, rows)];
      this.against = checkUnits(rows, this.car(), this.known);
      const unknown = isUnset(this.lib.field("config", "mass"), this.desk.get("mass"))
        ? ["The mass is not known: no stiffness is valid until it is set."]
        : [];
      this.notes([...unknown, ...rows.notes, ...sampling]);
      $("against").textContent = this.against.length
        ? `${this.against.join("\n")}\nUntil this is corrected, no value of this log is usable, ` +
          "even in rows that are marked as valid."
        : "";
      this.rows = rows;
      this.table = null;
      this.stopped = false;
      this.chart.whole = true;
      $("found").hidden = false;
      $("truth-key").hidden = !Object.keys(rows.truth ?? {}).length;
      $("progress").hidden = false;
      $("run").disabled = true;
      $("stop").disabled = false;
      for (const id of ["save-est", "save-log", "save-car"]) $(id).disabled = true;
      if (innerWidth < 760) $("results").scrollIntoView();
      const began = performance.now();
      let drawn = 0;
      const seen = (table) => {
        this.table = table;
        const share = table.rows / rows.time.length;
        $("progress").value = share;
        // drawing takes at most a tenth of the time
        if (performance.now() - drawn < Math.max(100, 10 * this.chart.cost) && share < 1) return;
        drawn = performance.now();
        this.say(`${table.rows} of ${rows.time.length} rows`);
        this.now();
      };
      try {
        this.used = this.desk;
        await estimate(this.desk, rows, seen, () => this.stopped);
      } finally {
        $("progress").hidden = true;
        $("stop").disabled = true;
        $("run").disabled = false;
      }
      const seconds = (performance.now() - began) / 1000,
        all = this.table.rows === rows.time.length;
      this.now();
      this.reasons();
      for (const id of ["save-est", "save-log", "save-car"]) $(id).disabled = false;
      this.say(
        `${all ? "Done" : "Stopped"}: ${this.table.rows} rows of ${rows.name} in ${tidy(seconds, 2)} s.`,
      );
    });
    this.running = ok;
    await ok;
  }

  at(name, i = this.table.rows - 1) {
    const value = this.table.columns[name][i];
    return name.endsWith("_reason") ? this.table.reasonText(value) : value;
  }

  now() {
    const t = this.table,
      i = t.rows - 1;
    if (i < 0) return;
    const share = (s) => `${Math.round((100 * t.valid[s]) / t.rows)} %`;
    $("itself").textContent = $("known").value === "1" ? ITSELF : "";
    showCards(
      $("cards"),
      (name) => this.at(name),
      (s) => this.rows.truth?.[s]?.[i] ?? null,
      share,
      this.against.length > 0,
    );
    $("change").textContent = describeChange((name) => this.at(name), t.time[i]);
    this.chart.later();
  }

  reasons() {
    const t = this.table,
      codes = [...this.lib.tables.reason.map((f) => f.offset), -1];
    const text = (c) =>
      c < 0 ? "the library refused the row" : this.lib.tables.reason.find((f) => f.offset === c).text;
    const counts = codes.map((c) => [
      c,
      ...STIFFNESS.map((s) => {
        let n = 0;
        const column = t.columns[`${s}_reason`];
        for (let i = 0; i < t.rows; i++) n += column[i] === c;
        return n;
      }),
    ]);
    const table = make(
      "table",
      {},
      make(
        "tr",
        {},
        ...["reason", "meaning", ...STIFFNESS.map((s) => SHORT[s])].map((x) =>
          make("th", { textContent: x, style: "text-align:left;padding-right:14px" }),
        ),
      ),
    );
    for (const [code, ...n] of counts.filter((c) => c.slice(1).some(Boolean))) {
      table.append(
        make(
          "tr",
          {},
          ...[t.reasonText(code), text(code), ...n.map((x) => `${tidy((100 * x) / t.rows, 3)} %`)].map((x) =>
            make("td", { textContent: x, style: "padding-right:14px" }),
          ),
        ),
      );
    }
    $("reasons").replaceChildren(table);
  }

  // Estimate the rows of a drive of the pane Drive. `settings`: those of the simulated
  // car.
  async adopt(rows, settings) {
    await this.halt();
    this.file = null;
    $("mapping").hidden = true;
    this.said.clear();
    this.driven = DRIVEN.front;
    for (const name of this.lib.groups.flat()) this.desk.set(name, settings[name]);
    $("known").value = "0";
    this.show();
    await this.run(rows);
  }
}

// Return the rows of the last estimate, to repeat it without a file.
function repeatRows(pane) {
  if (!pane.rows) throw new Wrong("drop a log, or press Built-in example");
  return pane.rows;
}

// Offer text to the user as a file.
function save(parts, name) {
  const url = URL.createObjectURL(new Blob(parts, { type: "text/plain" }));
  const link = make("a", { href: url, download: name });
  document.body.append(link);
  link.click();
  link.remove();
  setTimeout(() => URL.revokeObjectURL(url), 10_000);
}
