// draw.js - plots on a canvas: panels below each other with a common time axis, which are
// zoomed and moved together. If several rows share a pixel, a line from their min to their
// max is drawn, so that peaks of single rows are visible even in a log of hours.

// [px] heights: space below a panel, title of a panel, time axis, bar of the validity, and
// row of a panel of probabilities
const GAP = 8, TITLE = 18, AXIS = 22, STRIP = 9, HEAT = 17;
const SHORTEST = 0.05;      // [s] min length of the time that is shown
// Max half width of the interval for which the vertical range of a panel is extended, as a
// share of the mean. At the start of a drive the intervals are so wide that the line would
// be flat if they were shown completely.
const WIDEST_BAND = 0.35;
const BAND = 1.96;          // half of a 95 % interval of normal errors, in sd

class Chart {
  // panels: a list of
  //   {title, unit, scale, height, lines: [{name, values(), color, dash}], band: {mean(), sd()},
  //    strip: {valid(), reason(i)}, zero: true if the vertical range must include 0}
  //   or {title, heat: [{name, values(), color}]}, whose values are probabilities.
  // time(): {t: times of the rows [s], n: number of rows}.
  // live: [s] length of the time that is shown during a drive. null: the drive has ended,
  // and the plot can be zoomed and moved.
  constructor(host, { panels, time, label, live = null }) {
    // cost: [ms] duration of the last draw()
    Object.assign(this, { panels, time, live, from: 0, to: 1, whole: true, cursor: null, pointers: new Map(), cost: 0 });
    this.canvas = Object.assign(document.createElement("canvas"), { tabIndex: 0, className: "chart" });
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", label);
    const bar = Object.assign(document.createElement("div"), { className: "zoom" });
    for (const [text, title, act] of [["+", "closer (key +)", () => this.zoom(0.5)], ["−", "wider (key -)", () => this.zoom(2)],
      ["←", "earlier (key ←)", () => this.move(-0.25)], ["→", "later (key →)", () => this.move(0.25)], ["all", "the whole time (key 0)", () => this.all()]]) {
      const button = Object.assign(document.createElement("button"), { type: "button", textContent: text, title });
      button.setAttribute("aria-label", title);
      button.onclick = act;
      bar.append(button);
    }
    host.replaceChildren(...(live ? [] : [bar]), this.canvas);
    new ResizeObserver(() => this.later()).observe(host);
    if (!live) this.listen();
  }

  listen() {
    const c = this.canvas;
    c.addEventListener("wheel", (e) => { e.preventDefault(); this.zoom(Math.exp(e.deltaY * 0.0015), this.timeAt(e.offsetX)); }, { passive: false });
    c.addEventListener("dblclick", () => this.all());
    c.addEventListener("pointerdown", (e) => { c.setPointerCapture(e.pointerId); this.pointers.set(e.pointerId, e.offsetX); });
    for (const end of ["pointerup", "pointercancel"]) c.addEventListener(end, (e) => this.pointers.delete(e.pointerId));
    c.addEventListener("pointerleave", () => { this.cursor = null; this.later(); });
    c.addEventListener("pointermove", (e) => {
      const before = this.pointers.get(e.pointerId);
      if (before === undefined) {
        this.cursor = this.timeAt(e.offsetX);
      } else if (this.pointers.size === 1) {
        this.move((before - e.offsetX) / this.width);
        this.pointers.set(e.pointerId, e.offsetX);
      } else {
        const other = [...this.pointers].find(([id]) => id !== e.pointerId)[1];
        const was = Math.abs(before - other), is = Math.abs(e.offsetX - other);
        if (is > 5 && was > 5) this.zoom(was / is, this.timeAt((e.offsetX + other) / 2));
        this.pointers.set(e.pointerId, e.offsetX);
      }
      this.later();
    });
    c.addEventListener("keydown", (e) => {
      const act = { "+": () => this.zoom(0.5), "=": () => this.zoom(0.5), "-": () => this.zoom(2), ArrowLeft: () => this.move(-0.1),
        ArrowRight: () => this.move(0.1), 0: () => this.all() }[e.key];
      if (act) { e.preventDefault(); act(); }
    });
  }

  span() {
    const { t, n } = this.time();
    return n ? [t[0], Math.max(t[n - 1], t[0] + SHORTEST)] : [0, 1];
  }

  timeAt(x) { return this.from + ((x - this.left) / this.width) * (this.to - this.from); }

  zoom(by, about = (this.from + this.to) / 2) {
    const [first, last] = this.span();
    const length = Math.min(Math.max((this.to - this.from) * by, SHORTEST), last - first);
    const share = (about - this.from) / (this.to - this.from);
    this.show(about - share * length, about - share * length + length);
  }

  move(share) {
    const by = share * (this.to - this.from);
    this.show(this.from + by, this.to + by);
  }

  show(from, to) {
    const [first, last] = this.span(), length = Math.min(to - from, last - first);
    this.from = Math.min(Math.max(from, first), last - length);
    this.to = this.from + length;
    this.whole = length >= 0.999 * (last - first);
    this.later();
  }

  all() { this.whole = true; this.later(); }

  later() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      const began = performance.now();
      this.draw();
      this.cost = performance.now() - began;
    });
  }

  draw() {
    const { t, n } = this.time(), c = this.canvas, ratio = window.devicePixelRatio || 1;
    const wide = c.parentElement.clientWidth;
    if (!wide) return;                                        // the canvas is in a hidden tab
    const height = (p) => (p.heat ? TITLE + HEAT * p.heat.length : TITLE + p.height + (p.strip ? STRIP + 3 : 0)) + GAP;
    const tall = this.panels.reduce((sum, p) => sum + height(p), 0) + AXIS;
    if (c.width !== Math.round(wide * ratio) || c.height !== Math.round(tall * ratio)) {
      c.width = Math.round(wide * ratio);
      c.height = Math.round(tall * ratio);
      c.style.height = `${tall}px`;
    }
    const style = getComputedStyle(c);
    this.ink = Object.fromEntries(["ink", "soft", "line", "good", "bad", "panel", "est", "truth", "warn"].map((k) => [k, style.getPropertyValue(`--${k}`).trim()]));
    this.g = c.getContext("2d");
    this.g.setTransform(ratio, 0, 0, ratio, 0, 0);
    this.g.clearRect(0, 0, wide, tall);
    this.g.font = "12px system-ui, sans-serif";
    this.left = wide < 500 ? 42 : 58;
    this.width = wide - this.left - 8;
    const [first, last] = this.span();
    if (this.live) [this.from, this.to] = [Math.max(first, last - this.live), Math.max(last, first + this.live)];
    else if (this.whole) [this.from, this.to] = [first, last];
    const low = lower(t, n, this.from), high = Math.min(n, lower(t, n, this.to) + 1);
    this.shown = { t, low: Math.max(0, low - 1), high, n };
    let top = 0;
    for (const p of this.panels) {
      if (p.heat) this.heat(p, top);
      else this.panel(p, top);
      top += height(p);
    }
    this.axis(top - GAP);
    if (this.cursor !== null) {
      const x = this.x(this.cursor);
      this.stroke(this.ink.soft, 1, [2, 2], () => { this.g.moveTo(x, TITLE); this.g.lineTo(x, top - GAP); });
    }
  }

  x(time) { return this.left + ((time - this.from) / (this.to - this.from)) * this.width; }

  stroke(color, width, dash, path) {
    const { g } = this;
    g.save();
    g.strokeStyle = color;
    g.lineWidth = width;
    g.setLineDash(dash);
    g.lineJoin = "round";
    g.beginPath();
    path();
    g.stroke();
    g.restore();
  }

  // Return {small, large}: for each pixel column the min of lowOf(i) and the max of highOf(i)
  // over the rows i in this column. NaN: there is no row.
  columns(lowOf, highOf) {
    const pixels = Math.max(1, Math.floor(this.width)), { t, low, high } = this.shown;
    const small = new Float64Array(pixels + 1).fill(NaN), large = new Float64Array(pixels + 1).fill(NaN);
    const scale = pixels / (this.to - this.from);
    for (let i = low; i < high; i++) {
      const at = Math.min(pixels, Math.max(0, Math.floor((t[i] - this.from) * scale)));
      const a = lowOf(i), b = highOf(i);
      if (!(small[at] <= a)) small[at] = Number.isNaN(a) ? small[at] : a;
      if (!(large[at] >= b)) large[at] = Number.isNaN(b) ? large[at] : b;
    }
    return { small, large };
  }

  get dense() { return this.shown.high - this.shown.low > 1.5 * this.width; }

  panel(p, top) {
    const { g, ink } = this, { low, high } = this.shown, scale = p.scale ?? 1;
    const box = { top: top + TITLE, height: p.height };
    let min = Infinity, max = -Infinity;
    const widen = (v) => { if (v < min) min = v; if (v > max) max = v; };
    for (const l of p.lines) {
      const v = l.values();
      for (let i = low; v && i < high; i++) widen(v[i]);
    }
    const mean = p.band?.mean(), sd = p.band?.sd();
    for (let i = low; mean && i < high; i++) {
      const half = Math.min(BAND * sd[i], WIDEST_BAND * Math.abs(mean[i]));
      widen(mean[i] - half);
      widen(mean[i] + half);
    }
    if (p.zero) widen(0);
    if (!(max >= min)) [min, max] = [0, 1];
    const extra = 0.06 * (max - min || Math.abs(max) || 1);
    min -= extra;
    max += extra;
    const y = (v) => box.top + box.height * (1 - (v - min) / (max - min));
    this.title(p, top, this.readings(p));
    g.fillStyle = ink.panel;
    g.fillRect(this.left, box.top, this.width, box.height);
    for (const v of ticks(min * scale, max * scale, Math.max(2, box.height / 25))) {
      const at = y(v / scale);
      this.stroke(ink.line, 1, [], () => { g.moveTo(this.left, at); g.lineTo(this.left + this.width, at); });
      g.fillStyle = ink.soft;
      g.textAlign = "right";
      g.fillText(tidy(v), this.left - 5, at + 4);
    }
    g.save();
    g.beginPath();
    g.rect(this.left, box.top, this.width, box.height);
    g.clip();
    for (const v of ticks(this.from, this.to, this.width / 90)) {
      this.stroke(ink.line, 1, [], () => { g.moveTo(this.x(v), box.top); g.lineTo(this.x(v), box.top + box.height); });
    }
    if (mean) this.area((i) => mean[i] - BAND * sd[i], (i) => mean[i] + BAND * sd[i], y, ink[p.band.color ?? "est"]);
    for (const l of p.lines) {
      const v = l.values();
      if (v) this.line(v, y, ink[l.color], l.dash ?? [], l.width ?? 1.6);
    }
    g.restore();
    if (p.strip) this.strip(p.strip, box.top + box.height + 3);
  }

  line(v, y, color, dash, width) {
    const { g } = this, { t, low, high } = this.shown;
    this.stroke(color, width, dash, () => {
      let pen = false;
      if (!this.dense) {
        for (let i = low; i < high; i++) {
          if (Number.isNaN(v[i])) { pen = false; continue; }
          if (pen) g.lineTo(this.x(t[i]), y(v[i]));
          else g.moveTo(this.x(t[i]), y(v[i]));
          pen = true;
        }
        return;
      }
      const { small, large } = this.columns((i) => v[i], (i) => v[i]);
      for (let k = 0; k < small.length; k++) {
        if (Number.isNaN(small[k])) { pen = false; continue; }
        if (pen) g.lineTo(this.left + k, y(small[k]));
        else g.moveTo(this.left + k, y(small[k]));
        if (large[k] > small[k]) g.lineTo(this.left + k, y(large[k]));
        pen = true;
      }
    });
  }

  area(lowOf, highOf, y, color) {
    const { g } = this, { small, large } = this.columns(lowOf, highOf), there = [];
    for (let k = 0; k < small.length; k++) if (!Number.isNaN(small[k])) there.push(k);
    if (!there.length) return;
    g.save();
    g.globalAlpha = 0.22;
    g.fillStyle = color;
    g.beginPath();
    for (const k of there) g.lineTo(this.left + k, y(large[k]));
    for (const k of there.reverse()) g.lineTo(this.left + k, y(small[k]));
    g.fill();
    g.restore();
  }

  // Draw the bar of the validity: thick and green in rows with a valid value, thin and red
  // in other rows.
  strip(strip, top) {
    const { g, ink } = this, valid = strip.valid();
    if (!valid) return;
    const { small } = this.columns((i) => valid[i], (i) => valid[i]);
    const rowsPerPixel = this.dense, end = this.lastPixel();
    let last = NaN;
    for (let k = 0; k < small.length && k <= end; k++) {
      const v = Number.isNaN(small[k]) ? (rowsPerPixel ? NaN : last) : small[k];
      last = v;
      if (Number.isNaN(v)) continue;
      g.fillStyle = v ? ink.good : ink.bad;
      g.fillRect(this.left + k, v ? top : top + STRIP / 2 - 1, 1, v ? STRIP : 2);
    }
  }

  heat(p, top) {
    const { g, ink } = this;
    this.title(p, top, []);
    const i = this.cursorRow();
    p.heat.forEach((h, row) => {
      const y = top + TITLE + row * HEAT, v = h.values();
      g.fillStyle = ink.panel;
      g.fillRect(this.left, y, this.width, HEAT - 3);
      if (v) {
        const { large } = this.columns((k) => v[k], (k) => v[k]);
        g.fillStyle = ink[h.color];
        const end = this.lastPixel();
        let last = 0;
        for (let k = 0; k < large.length && k <= end; k++) {
          const share = Number.isNaN(large[k]) ? (this.dense ? 0 : last) : large[k];
          last = share;
          const tall = share * (HEAT - 3);
          if (tall > 0.2) g.fillRect(this.left + k, y + HEAT - 3 - tall, 1, tall);
        }
      }
      const text = v && i >= 0 ? `${h.name} ${Math.round(100 * v[i])} %` : h.name;
      g.textAlign = "left";
      g.globalAlpha = 0.85;
      g.fillStyle = ink.panel;
      g.fillRect(this.left, y, g.measureText(text).width + 10, HEAT - 3);
      g.globalAlpha = 1;
      g.fillStyle = ink.ink;
      g.fillText(text, this.left + 5, y + HEAT - 6);
    });
  }

  // Return the pixel column of the last row. During a drive, nothing is drawn to the right
  // of this column.
  lastPixel() {
    const { t, n } = this.shown;
    return n ? Math.floor(this.x(t[n - 1]) - this.left) : -1;
  }

  cursorRow() {
    const { t, n } = this.shown;
    if (!n) return -1;
    return this.cursor === null ? n - 1 : Math.min(n - 1, Math.max(0, lower(t, n, this.cursor)));
  }

  // Return the values of a panel at the cursor, or in the last row if there is no cursor, as
  // a list of [text, colour].
  readings(p) {
    const i = this.cursorRow(), out = [];
    if (i < 0) return out;
    for (const l of p.lines) {
      const v = l.values();
      if (!v || Number.isNaN(v[i])) continue;
      const half = p.band && l.band ? BAND * p.band.sd()[i] * (p.scale ?? 1) : null;
      out.push([`${l.name} ${tidy(v[i] * (p.scale ?? 1), 4)}${half === null ? "" : ` ± ${tidy(half, 2)}`}`, l.color]);
    }
    if (p.strip?.valid()) out.push([p.strip.reason(i), p.strip.valid()[i] ? "good" : "bad"]);
    return out;
  }

  title(p, top, readings) {
    const { g, ink } = this;
    g.textAlign = "left";
    g.font = "600 12px system-ui, sans-serif";
    g.fillStyle = ink.ink;
    const narrow = this.width < 480, text = `${narrow ? p.short ?? p.title : p.title}${p.unit ? ` [${p.unit}]` : ""}`;
    g.fillText(text, this.left, top + 13);
    const free = this.left + g.measureText(text).width + 10;
    g.font = "12px system-ui, sans-serif";
    let right = this.left + this.width;
    for (const [word, color] of readings.reverse()) {
      const wide = g.measureText(word).width;
      if (right - wide < free) continue;
      g.fillStyle = ink[color];
      g.fillText(word, right - wide, top + 13);
      right -= wide + 12;
    }
  }

  axis(top) {
    const { g, ink } = this;
    g.fillStyle = ink.soft;
    g.textAlign = "center";
    for (const v of ticks(this.from, this.to, this.width / 90)) {
      const x = this.x(v);
      this.stroke(ink.line, 1, [], () => { g.moveTo(x, top); g.lineTo(x, top + 4); });
      const text = `${tidy(v, 7)} s`, half = g.measureText(text).width / 2;
      g.fillText(text, Math.min(x, this.left + this.width - half), top + 17);
    }
  }
}

// Return the first of n rows whose time is at or after `time`; n if there is none.
function lower(t, n, time) {
  let a = 0, b = n;
  while (a < b) {
    const middle = (a + b) >> 1;
    if (t[middle] < time) a = middle + 1;
    else b = middle;
  }
  return a;
}

// Return round values between min and max for the ticks of an axis. `about` is the
// approximate max number of ticks.
function ticks(min, max, about) {
  const raw = (max - min) / Math.max(1, about), power = 10 ** Math.floor(Math.log10(raw));
  const step = power * [1, 2, 5, 10].find((m) => m * power >= raw), out = [];
  for (let k = Math.ceil(min / step); k * step <= max; k++) out.push(k * step);
  return out;
}

// Return a number as text, rounded to `digits` significant digits. All digits before the
// decimal point are kept.
function tidy(x, digits = 3) {
  if (Math.abs(x) < 1e-9) return "0";
  return String(+x.toPrecision(Math.max(digits, Math.ceil(Math.log10(Math.abs(x) + 1))))).replace("-", "−");
}
