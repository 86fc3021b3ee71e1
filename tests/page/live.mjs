// node live.mjs NODE_MODULES BROWSER URL FOLDER - the page of `tselab live` in a real browser while rows come; says what was seen as
// JSON. Pictures are left in FOLDER.
import { mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join, resolve } from "node:path";

const [modules, browserPath, url, folder] = process.argv.slice(2);
const puppeteer = createRequire(resolve(modules, "x.js"))("puppeteer-core");
mkdirSync(folder, { recursive: true });
const browser = await puppeteer.launch({
  executablePath: browserPath, headless: true,
  args: ["--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--force-device-scale-factor=1", "--hide-scrollbars"],
});
const seen = { errors: [], requests: [] };
for (const [name, scheme, width, height] of [["live-light", "light", 1200, 900], ["live-phone", "dark", 390, 800]]) {
  const page = await browser.newPage();
  await page.emulateMediaFeatures([{ name: "prefers-color-scheme", value: scheme }]);
  await page.setViewport({ width, height });
  page.on("request", (r) => seen.requests.push(r.url()));
  page.on("pageerror", (e) => seen.errors.push(e.message));
  page.on("console", (m) => m.type() === "error" && seen.errors.push(m.text()));
  await page.goto(url);
  await page.waitForFunction("document.querySelectorAll('#answer .use').length === 3", { timeout: 30_000 });
  const five = (await page.$$("[data-span]"))[1];
  await five.click();
  await new Promise((go) => setTimeout(go, 700));
  seen[name] = await page.evaluate(() => {
    const chart = document.querySelector("canvas.chart"), ink = chart.getContext("2d"), ratio = window.devicePixelRatio;
    const text = (id) => document.getElementById(id).textContent;
    return {
      answer: [...document.querySelectorAll("#answer span")].map((e) => e.textContent), car: text("car"), state: text("state"),
      overflow: document.documentElement.scrollWidth - window.innerWidth,
      cut: [...document.querySelectorAll("#answer span")].some((e) => e.getBoundingClientRect().right > window.innerWidth),
      // nothing is drawn behind the last row: the strip below the first panel, one pixel from its right end
      behind: [...ink.getImageData(chart.width - 12 * ratio, (18 + 120 + 3 + 4) * ratio, 1, 1).data],
    };
  });
  await page.screenshot({ path: join(folder, `${name}.png`), fullPage: true });
  await page.close();
}
await browser.close();
process.stdout.write(JSON.stringify(seen));
