// page.mjs - run a log through the scripts of the page, without a browser:
// node page.mjs JOB.json > ROWS.json
// JOB: folder of the scripts of the page, PAGE, wasm (base64), known, car, time, channels.
import fs from "node:fs";
import vm from "node:vm";

const job = JSON.parse(fs.readFileSync(process.argv[2], "utf8"));
const code = ["core.js", "text.js", "map.js", "check.js", "run.js"]
  .map((name) => fs.readFileSync(`${job.scripts}/${name}`, "utf8"))
  .join("\n");
const work = `
const lib = await Library.load(Uint8Array.from(atob(job.wasm), (c) => c.charCodeAt(0))), desk = lib.desk(0);
if (job.known) desk.exact();
else desk.defaults();
for (const [name, value] of Object.entries(job.car)) desk.set(name, value);
const rows = { name: "log", time: Float64Array.from(job.time), data: {}, notes: [], sampleTime: 0.01 };
for (const f of lib.channels) rows.data[f.name] = Float64Array.from(job.channels[f.name]);
setSampling(desk, rows.sampleTime);
const said = checkUnits(rows, job.car, {}), table = await estimate(desk, rows, () => {}, () => false);
const names = ["status", "cx_front_reason", "cy_front_reason", "cy_rear_reason", "fault_channel", "fault_factor"];
return { said, columns: Object.fromEntries(names.map((n) => [n, Array.from(table.columns[n])])) };
`;
const run = vm.compileFunction(`return (async () => {${code}\n${work}})();`, ["PAGE", "job"], {});
const text = JSON.stringify(await run({ ...job.page, example: null }, job));
process.stdout.write(text, () => process.exit(0)); // exit: a message channel of the page is still open
