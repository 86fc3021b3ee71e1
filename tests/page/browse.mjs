// browse.mjs - use the page as a person does, in a browser without a network:
// node browse.mjs NODE_MODULES BROWSER PAGE FOLDER LOGS.json > SEEN.json
// Screenshots and downloads are written to FOLDER. LOGS.json: {logs, cars, checks}, the files
// to drop, by name.
import { readFileSync, mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";
import { pathToFileURL } from "node:url";

const [modules, browserPath, page_, folder, logsFile] = process.argv.slice(2);
const puppeteer = createRequire(resolve(modules, "x.js"))("puppeteer-core");
const { logs, cars, checks } = JSON.parse(readFileSync(logsFile, "utf8"));
mkdirSync(folder, { recursive: true });

const browser = await puppeteer.launch({
  executablePath: browserPath,
  headless: true,
  args: [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--force-device-scale-factor=1",
    "--hide-scrollbars",
  ],
});
const seen = { requests: [], errors: [], logs: {}, cars: {}, checks: {} };

async function open(scheme, width, height) {
  const page = await browser.newPage();
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
  await page.setViewport({ width, height });
  page.on("request", (r) => seen.requests.push(r.url()));
  page.on("pageerror", (e) => seen.errors.push(e.message));
  page.on("console", (m) => m.type() === "error" && seen.errors.push(m.text()));
  await page.goto(pathToFileURL(page_).href);
  await page.waitForFunction("window.tse || document.getElementById('fatal').textContent");
  return page;
}
const text = (page, id) => page.$eval(`#${id}`, (e) => e.textContent);
const shoot = (page, name) => page.screenshot({ path: join(folder, `${name}.png`), fullPage: true });
const settle = (page) =>
  page.evaluate(() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go))));

async function finished(page) {
  await page.waitForFunction(
    () =>
      /^(Done|Stopped)/.test(document.getElementById("state").textContent) ||
      document.getElementById("log-wrong").textContent ||
      document.getElementById("car-wrong").textContent ||
      /Then estimate/.test(document.getElementById("state").textContent),
    { timeout: 30_000 },
  );
  await settle(page);
}

// Press a button that downloads a file; return the text of the file.
async function handed(page, id) {
  return page.evaluate(async (button) => {
    const real = URL.createObjectURL;
    const given = new Promise((go) => {
      URL.createObjectURL = (blob) => {
        go(blob);
        return real.call(URL, blob);
      };
    });
    document.getElementById(button).click();
    const text = await (await given).text();
    URL.createObjectURL = real;
    return text;
  }, id);
}

async function drop(page, name, file = logs[name]) {
  const input = await page.$("#file");
  await page.$eval("#state", (e) => {
    e.textContent = "";
  });
  await input.uploadFile(file);
  await finished(page).catch(async (error) => {
    throw new Error(
      `${name}: ${error.message}: ${(await text(page, "log-wrong")) + (await text(page, "state"))}`,
    );
  });
}

async function files(page) {
  return {
    est: await handed(page, "save-est"),
    log: await handed(page, "save-log"),
    car: await handed(page, "save-car"),
  };
}

// ---- the example, in light colours
const page = await open("light", 1200, 900);
seen.fatal = await text(page, "fatal");
seen.foot = await text(page, "built");
await shoot(page, "start-light");
await page.click("#example");
await finished(page);
seen.logs.example = {
  ...(await files(page)),
  state: await text(page, "state"),
  change: await text(page, "change"),
  cards: await text(page, "cards"),
};
await shoot(page, "example-light");
// a peak of one row is visible at any zoom
seen.peak = await page.evaluate(() => {
  const c = document.createElement("div");
  c.style.width = "300px";
  document.body.append(c);
  const n = 200_000,
    t = Float64Array.from({ length: n }, (_, i) => i),
    v = new Float64Array(n);
  v[77_777] = 1;
  const chart = new window.tse.log.chart.constructor(c, {
    label: "",
    time: () => ({ t, n }),
    panels: [{ title: "", unit: "", height: 60, lines: [{ name: "", values: () => v, color: "est" }] }],
  });
  chart.draw();
  const { large } = chart.columns(
    (i) => v[i],
    (i) => v[i],
  );
  c.remove();
  return Math.max(...large.filter((x) => !Number.isNaN(x)));
});
await page.focus("#chart canvas");
await page.keyboard.press("+");
await page.keyboard.press("+");
await settle(page);
seen.zoomed = await page.evaluate(() => window.tse.log.chart.to - window.tse.log.chart.from);
await page.keyboard.press("0");

// ---- other logs: a log has no mass, and without a mass no stiffness is valid
await drop(page, "plain");
await page.click("#run");
await finished(page);
seen.noMass = {
  ...(await files(page)),
  notes: await text(page, "log-notes"),
  mass: await page.$eval("#set-mass", (e) => [e.value, e.placeholder]),
};
const stiff = () => page.$eval("#set-cornering_stiffness_front", (e) => [e.value, Number(e.placeholder)]);
seen.noMass.before = await stiff();
await page.$eval("#set-mass", (e) => {
  e.value = "1900";
  e.dispatchEvent(new Event("change"));
});
seen.noMass.after = await stiff();
for (const name of Object.keys(logs)) {
  await drop(page, name);
  const at = {
    wrong: await text(page, "log-wrong"),
    notes: await text(page, "log-notes"),
    state: await text(page, "state"),
    hint: await text(page, "map-hint"),
  };
  if (!at.wrong && /Then estimate/.test(at.state)) {
    at.map = await page.evaluate(() => structuredClone(window.tse.log.file.map));
    if (name === "german") await shoot(page, "mapping-light");
    await page.click("#run");
    await finished(page);
  }
  if (!at.wrong) Object.assign(at, await files(page), { state: await text(page, "state") });
  seen.logs[name] = at;
}
// channels that contradict each other
for (const [name, file] of Object.entries(checks)) {
  await drop(page, name, file);
  if (/Then estimate/.test(await text(page, "state"))) {
    await page.click("#run");
    await finished(page);
  }
  seen.checks[name] = {
    against: await text(page, "against"),
    wrong: await text(page, "log-wrong"),
    cards: await text(page, "cards"),
    map: await page.evaluate(() => structuredClone(window.tse.log.file?.map ?? null)),
    hint: await text(page, "map-hint"),
    "ratio sd": await page.evaluate(() => window.tse.log.car().steer_ratio_sd),
  };
  if (name === "yaw sign") await shoot(page, "against-light");
}
// a vehicle file without a steering ratio keeps the sd of the guessed one
await (await page.$("#car-file")).uploadFile(cars.little);
await page.waitForFunction("/little/.test(document.getElementById('state').textContent)");
seen.looseAfterCar = await page.evaluate(() => window.tse.log.car().steer_ratio_sd);
if (logs.broken) {
  await drop(page, "broken");
  await shoot(page, "broken-light");
}
// every control has a name for screen readers
seen.nameless = await page.evaluate(() =>
  [...document.querySelectorAll("button, input, select, canvas, progress")]
    .filter((e) => !(e.labels?.length || e.getAttribute("aria-label") || e.textContent.trim()))
    .map((e) => e.outerHTML.slice(0, 120)),
);
// vehicle files
for (const name of Object.keys(cars)) {
  await page.$eval("#state", (e) => {
    e.textContent = "waiting";
  });
  await (await page.$("#car-file")).uploadFile(cars[name]);
  await page.waitForFunction(
    "document.getElementById('state').textContent !== 'waiting' || " +
      "document.getElementById('car-wrong').textContent",
  );
  seen.cars[name] = {
    wrong: await text(page, "car-wrong"),
    settings: await page.evaluate(() => window.tse.log.car()),
  };
}
// a log opened after its vehicle file keeps the settings of the file
await (await page.$("#car-file")).uploadFile(cars.little);
await page.waitForFunction("/little/.test(document.getElementById('state').textContent)");
await drop(page, "plain");
seen.kept = await page.evaluate(() => window.tse.log.car());
await page.$eval("#set-mass", (e) => {
  e.value = "5";
  e.dispatchEvent(new Event("change"));
});
seen.mass = await text(page, "car-wrong");
await page.$eval("#vehicle-more", (e) => {
  e.open = true;
});
await page.click("#run");
seen.refused = await page.evaluate(() => ({
  state: document.getElementById("state").textContent,
  focus: document.activeElement.id,
  invalid: document.getElementById("set-mass").getAttribute("aria-invalid"),
}));
await page.close();

// ---- a drive with dark colours: the weaving driver on a dry road, then on a wet one; the test
// advances the time
const dark = await open("dark", 1200, 900);
await dark.click("#tab-drive");
seen.drive = await dark.evaluate(() => {
  const { drive } = window.tse,
    go = (seconds) => {
      for (let i = 0; i < 100 * seconds; i++) drive.row();
      drive.show();
    };
  const now = () => ({
    time: drive.t[drive.n - 1],
    est: drive.at("cy_front"),
    sd: drive.at("cy_front_sd"),
    truth: drive.at("true_cy_front"),
    valid: drive.at("cy_front_valid"),
    kind: drive.at("change_kind"),
    age: drive.at("change_age"),
  });
  go(20);
  const dry = now();
  [...document.getElementById("roads").children].find((b) => b.textContent === "wet").click();
  go(20);
  return { dry, wet: now() };
});
await dark.evaluate(() => {
  const { drive } = window.tse;
  drive.said = -1e9;
  drive.show();
});
await settle(dark);
await shoot(dark, "drive-dark");
// sliders of road and noise by arrow keys, which then do not steer
seen.sliders = {};
for (const id of ["level", "noise"]) {
  const before = await dark.$eval(`#${id}`, (e) => Number(e.value));
  await dark.focus(`#${id}`);
  await dark.keyboard.press("ArrowLeft");
  seen.sliders[id] = before - (await dark.$eval(`#${id}`, (e) => Number(e.value)));
}
seen.sliders.auto = await dark.$eval("#auto", (e) => e.checked);
// keys steer
await dark.click("#go");
await dark.keyboard.down("ArrowLeft");
await new Promise((go) => setTimeout(go, 500));
seen.steered = await dark.evaluate(() => ({
  angle: window.tse.drive.angle,
  auto: document.getElementById("auto").checked,
  yaw: window.tse.drive.desk.sim("true_yaw_rate"),
}));
await dark.keyboard.up("ArrowLeft");
await dark.click("#keep");
await finished(dark);
seen.logs.drive = { ...(await files(dark)), state: await text(dark, "state") };
await shoot(dark, "kept-dark");
await dark.close();

// ---- on a phone
const phone = await open("light", 390, 800);
await phone.click("#example");
await finished(phone);
await shoot(phone, "example-phone");
seen.overflow = await phone.evaluate(() => document.documentElement.scrollWidth - window.innerWidth);
await phone.click("#tab-drive");
await phone.evaluate(() => {
  const { drive } = window.tse;
  for (let i = 0; i < 900; i++) drive.row();
  drive.said = -1e9;
  drive.show();
});
await settle(phone);
await shoot(phone, "drive-phone");
seen.overflow = Math.max(
  seen.overflow,
  await phone.evaluate(() => document.documentElement.scrollWidth - window.innerWidth),
);
await phone.close();

await browser.close();
process.stdout.write(JSON.stringify(seen));
