// text.js - read and write numbers and text tables with the same bits as tselab.

// Return the shortest digits with the same bits, in the format of tselab (Arrow): 1,
// 0.000001, 1e-7, 1e+10. NaN: empty.
function formatShortest(x) {
  if (Number.isNaN(x)) return "";
  if (Math.abs(x) === Infinity) return x > 0 ? "inf" : "-inf";
  if (Object.is(x, -0)) return "-0";
  return Math.abs(x) >= 1e10 ? x.toExponential() : String(x);
}

// Return the digits of the nearest number in single precision, as in files of estimates.
function formatShortestSingle(x) {
  const single = Math.fround(x);
  if (!Number.isFinite(single) || single === 0) return formatShortest(single);
  for (let digits = 1; digits < 9; digits++) {
    const [more, power] = single.toExponential(digits).split("e"),
      half = more.endsWith("5") && Number(`${more}e${power}`) === single;
    const text =
      half && "02468".includes(more.at(-2))
        ? `${more.slice(0, -1)}e${power}`
        : single.toExponential(digits - 1);
    if (Math.fround(Number(text)) === single) return formatShortest(Number(text));
  }
  return formatShortest(Number(single.toPrecision(9)));
}

// Return the number in a cell as the nearest double, as pandas 3 does; NaN: no number.
function parseNumber(text, comma) {
  const plain = comma ? text.replace(",", ".") : text;
  const number = Number(plain);
  if (!Number.isNaN(number) && !/[xob_]/i.test(plain)) return number;
  return parseWord(text);
}

function parseWord(text) {
  const word = text.toLowerCase();
  if (word === "inf" || word === "+inf" || word === "infinity") return Infinity;
  return word === "-inf" || word === "-infinity" ? -Infinity : NaN;
}

const MISSING = new Set(["", "nan", "na", "n/a", "null", "none", "-nan", "#n/a", "#na", "<na>", "-"]);
const isNumber = (cell) => /^[-+]?(\d+([.,]\d*)?|[.,]\d+)([eE][-+]?\d+)?$/.test(cell);
const isClock = (cell) =>
  /^(\d{1,4}[-./]\d{1,2}[-./]\d{1,4}[ T])?\d{1,2}:\d{2}(:\d{2}([.,]\d+)?)?(Z|[+-]\d{2}:?\d{2})?$/.test(cell);
const isData = (cell) => isNumber(cell) || isClock(cell) || MISSING.has(cell.toLowerCase());

// Error in the input of the user; the text names the place and the allowed values.
class Wrong extends Error {}

// Return bytes of a file as text: UTF-8, UTF-16 with its mark, or else windows-1252.
function decode(bytes, name) {
  let text;
  if ((bytes[0] === 0xff && bytes[1] === 0xfe) || (bytes[0] === 0xfe && bytes[1] === 0xff)) {
    return new TextDecoder(bytes[0] === 0xff ? "utf-16le" : "utf-16be").decode(bytes);
  }
  try {
    text = new TextDecoder("utf-8", { fatal: true }).decode(bytes);
  } catch {
    const control = bytes
      .subarray(0, 4096)
      .reduce((n, c) => n + (c < 32 && ![9, 10, 12, 13, 26, 27].includes(c)), 0);
    text = control > 8 ? "\0" : new TextDecoder("windows-1252").decode(bytes);
  }
  if (text.slice(0, 65536).includes("\0")) {
    throw new Wrong(
      `${name}: is a binary file that this page does not read; it reads ` +
        `CSV${PAGE.parquet ? " and Parquet" : ""}. The command tselab reads MF4, BLF, ROS bags and MAT: ` +
        "'tselab estimate --help'",
    );
  }
  return text;
}

function splitCells(line, separator) {
  if (!line.includes('"')) return line.split(separator).map((c) => c.trim());
  const out = [];
  let cell = "",
    quoted = false;
  for (let i = 0; i < line.length; i++) {
    const c = line[i];
    if (c === '"') {
      if (quoted && line[i + 1] === '"') {
        cell += c;
        i++;
      } else quoted = !quoted;
    } else if (c === separator && !quoted) {
      out.push(cell.trim());
      cell = "";
    } else cell += c;
  }
  out.push(cell.trim());
  return out;
}

const HEAD = 400; // lines from which the format of a table is found
const SEPARATORS = { ",": "comma", ";": "semicolon", "\t": "tab", "|": "|" };

// Return the format of a text table: separator, decimal, line of the names, names, units,
// first line of data.
function findDialect(name, lines) {
  const head = lines.slice(0, HEAD),
    filled = head.filter((x) => x.trim());
  if (!filled.length) throw new Wrong(`${name}: is empty`);
  const tail = filled.slice(Math.floor(filled.length / 3));
  let separator = "",
    worth = 0;
  for (const s of Object.keys(SEPARATORS)) {
    const rows = tail.map((x) => splitCells(x, s)),
      counts = new Map();
    for (const r of rows) counts.set(r.length, (counts.get(r.length) ?? 0) + 1);
    const [width, often] = [...counts].sort((a, b) => b[1] - a[1])[0];
    if (width < 2) continue;
    const cells = rows.slice(0, 50).flat(),
      numeric = cells.filter(isData).length / cells.length;
    let value = (often / tail.length) * (0.2 + numeric) * (s === "," ? 0.9 : 1) + 1e-3 * width;
    if (s === "," && tail.slice(0, 3).some((x) => /[;\t]/.test(x))) value *= 0.5; // probably decimal commas
    if (value > worth) [separator, worth] = [s, value];
  }
  if (!separator)
    throw new Wrong(`${name}: is no table: no comma, semicolon, tab or | separates its lines into columns`);
  const cells = head.map((x) => splitCells(x, separator)),
    widths = new Map();
  const numeric = (c) => c.some(isNumber) && c.filter(isData).length >= 0.5 * c.length;
  for (const c of cells) if (numeric(c)) widths.set(c.length, (widths.get(c.length) ?? 0) + 1);
  if (!widths.size)
    throw new Wrong(
      `${name}: ${filled.length < 2 ? "has a header but no rows" : "no line holds numbers"}; the ` +
        "first line names the columns, each further line is a row",
    );
  const width = [...widths].sort((a, b) => b[1] - a[1])[0][0];
  const first = cells.findIndex(
    (c, i) =>
      c.length === width &&
      numeric(c) &&
      (i + 1 >= cells.length || cells[i + 1].length === width || !head[i + 1].trim()),
  );
  let header = first - 1,
    units = null;
  const isUnits = (c) =>
    c.some(Boolean) &&
    c.filter((u) => u && (findUnit(u) !== null || ["-", "1", "[-]", "[]"].includes(u))).length >
      0.6 * c.filter(Boolean).length;
  while (header >= 0 && cells[header].length < width) header--;
  if (header > 0 && isUnits(cells[header])) {
    units = cells[header].map((u) => u.replace(/^[[(]|[\])]$/g, ""));
    header--;
    while (header >= 0 && cells[header].length < width) header--;
  }
  if (header < 0)
    throw new Wrong(`${name}: the first line must name the columns; it is "${lines[0].slice(0, 60)}"`);
  const sample = cells.slice(first).flat();
  const comma = sample.filter((c) => /^[-+]?\d*,\d+([eE][-+]?\d+)?$/.test(c)).length;
  const point = sample.filter((c) => /^[-+]?\d*\.\d+([eE][-+]?\d+)?$/.test(c)).length;
  return {
    separator,
    decimal: comma > point ? "," : ".",
    header,
    names: cells[header].slice(0, width),
    units,
    first,
  };
}

// Read a text table: columns {name, unit, values (NaN: missing), bad: {count, line, text}
// of cells that are no numbers}, the line of each row in the file, notes. A last line
// without line break is left out, as it may be cut inside a number.
async function readText(name, bytes, breathe) {
  const text = decode(bytes, name).replace(/^\ufeff/, "");
  const lines = text.split(/\r\n|\n|\r/);
  const notes = [];
  const ends = /[\r\n]$/.test(text);
  const d = findDialect(name, lines);
  if (ends) lines.pop();
  else if (lines.length > d.first + 1) {
    notes.push(
      `line ${lines.length}, the last, has no line break: it may be cut inside a number and is left out`,
    );
    lines.pop();
  } else throw new Wrong(`${name}: has one row, without a line break: it may be cut inside a number`);
  // refuse a long file now, before reading takes minutes
  if (lines.length - d.first > MOST_ROWS + HEAD) throw makeLengthError(name, lines.length - d.first);
  const width = d.names.length,
    most = lines.length - d.first,
    comma = d.decimal === ",";
  const columns = d.names.map((n, i) => ({
    name: n,
    unit: d.units?.[i] ?? "",
    values: new Float64Array(most),
    bad: null,
  }));
  const line = new Int32Array(most);
  let rows = 0;
  for (let at = d.first; at < lines.length; at++) {
    if (at % 2000 === 0) await breathe(`reading ${name}`, at / lines.length);
    if (!lines[at].trim()) continue;
    const cells = splitCells(lines[at], d.separator);
    if (cells.length > width)
      throw new Wrong(
        `${name}: line ${at + 1}: ${cells.length} cells, but the header (line ${d.header + 1}) names ` +
          `${width} columns`,
      );
    for (let k = 0; k < width; k++) {
      const cell = cells[k] ?? "";
      let value = cell === "" ? NaN : parseNumber(cell, comma);
      if (Number.isNaN(value) && !MISSING.has(cell.toLowerCase())) {
        value = isClock(cell) ? parseClock(cell) : NaN;
        if (Number.isNaN(value)) {
          columns[k].bad ??= { count: 0, line: at + 1, text: cell };
          columns[k].bad.count++;
        }
      }
      columns[k].values[rows] = value;
    }
    line[rows++] = at + 1;
  }
  if (!rows) throw new Wrong(`${name}: has a header but no rows`);
  for (const c of columns) c.values = c.values.subarray(0, rows);
  if (d.separator !== "," || d.decimal !== "." || d.header || d.units) {
    notes.push(
      `read as CSV with ${SEPARATORS[d.separator]} and decimal ` +
        (d.decimal === "," ? "comma" : "point") +
        (d.header ? `, names in line ${d.header + 1}` : "") +
        (d.units ? ", a row of units" : ""),
    );
  }
  return { name, columns: columns.filter((c) => c.name), line: line.subarray(0, rows), place: "line", notes };
}

// Return the time in s of 12:03:04.5, with or without a date.
function parseClock(cell) {
  const t = /(\d{1,2}):(\d{2})(?::(\d{2}(?:[.,]\d+)?))?/.exec(cell);
  return t ? 3600 * t[1] + 60 * t[2] + Number((t[3] ?? "0").replace(",", ".")) : NaN;
}

// Read the numeric columns of a Parquet file, with hyparquet.
async function readParquet(name, bytes, breathe) {
  if (!PAGE.parquet)
    throw new Wrong(
      `${name}: this copy of the page cannot read Parquet: it was built without npm. Convert the file ` +
        "to CSV, or use the command tselab",
    );
  const columns = [],
    file = bytes.buffer.slice(bytes.byteOffset, bytes.byteOffset + bytes.byteLength);
  let rows = 0;
  try {
    const meta = parquet.parquetMetadata(file),
      schema = parquet.parquetSchema(meta);
    rows = Number(meta.num_rows);
    for (const [i, child] of schema.children.entries()) {
      await breathe(`reading ${name}`, i / schema.children.length);
      if (child.children.length) continue;
      const values = new Float64Array(rows).fill(NaN);
      const take = ({ columnData, rowStart }) => {
        for (let k = 0; k < columnData.length; k++) values[rowStart + k] = convertNumber(columnData[k]);
      };
      await parquet.parquetRead({
        file,
        metadata: meta,
        columns: [child.element.name],
        onChunk: take,
        compressors: parquet.compressors,
      });
      if (values.some((x) => !Number.isNaN(x)))
        columns.push({ name: child.element.name, unit: "", values, bad: null });
    }
  } catch (error) {
    throw new Wrong(`${name}: is not a Parquet file that can be read: ${error.message}`);
  }
  if (!rows) throw new Wrong(`${name}: has no rows`);
  return { name, columns, line: Int32Array.from({ length: rows }, (_, i) => i + 1), place: "row", notes: [] };
}

function convertNumber(value) {
  if (typeof value === "number") return value;
  if (typeof value === "bigint") return Number(value);
  return value instanceof Date ? value.getTime() / 1000 : NaN;
}
