// Run a program with the port of wasm.c: node wasm.js PROGRAM.wasm
const { readFileSync } = require("node:fs");

let memory;
const say = (at) => {
  const bytes = new Uint8Array(memory.buffer);
  process.stdout.write(Buffer.from(bytes.subarray(at, bytes.indexOf(0, at))).toString());
};
WebAssembly.instantiate(readFileSync(process.argv[2]), { port: { say } }).then(({ instance }) => {
  memory = instance.exports.memory;
  process.exitCode = instance.exports.run();
});
