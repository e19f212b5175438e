// Signals in text files, as data/traces.py reads them.

import { InputError } from "./errors.js";
import { separateTime } from "./time.js";

/**
 * Read the columns of a text file.
 *
 * @param {ArrayBuffer} buffer - The file.
 * @returns {{channels: Float64Array[], rate: number | null}} rate in Hz where a column of time
 *   gives it.
 */
export function parseTable(buffer) {
  const { above, data } = divide(decodeText(buffer));
  if (data.length === 0) throw new InputError("it holds no numbers");
  const [delimiter, decimalComma] = dialect(data);
  const columns = readNumbers(data, delimiter, decimalComma);
  const names = above
    .map((line) => cells(line, delimiter))
    .filter((each) => each.length === columns.length);
  return separateTime(columns, names);
}

function decodeText(buffer) {
  const [first, second] = new Uint8Array(buffer);
  if (first === 0xff && second === 0xfe) return new TextDecoder("utf-16le").decode(buffer);
  if (first === 0xfe && second === 0xff) return new TextDecoder("utf-16be").decode(buffer);
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(buffer);
  } catch {
    return new TextDecoder("latin1").decode(buffer); // for names alone
  }
}

/** Lines of words above the numbers, without marks of comments, and lines of numbers. */
function divide(text) {
  const found = { above: [], data: [] };
  for (const raw of text.replaceAll('"', "").split(/\r\n|[\n\r]/)) {
    const line = raw.trim().replace(/[;,\t ]+$/, "");
    if (!line) continue;
    if (found.data.length === 0 && !isNumbers(line)) {
      found.above.push(line.replace(/^[#% \t]+/, ""));
    } else if (!/^[#%]/.test(line)) {
      found.data.push(line);
    }
  }
  return found;
}

function isNumbers(line) {
  return line.split(/[;,\s]+/).every((field) => field === "" || isNumber(field));
}

function isNumber(field) {
  return /^[-+]?(\d+\.?\d*|\.\d+)(e[-+]?\d+)?$|^[-+]?(nan|inf|infinity)$/i.test(field);
}

/** Delimiter (null is white space) and whether commas are decimal commas. */
function dialect(data) {
  const first = data[0];
  let delimiter = null;
  if (first.includes(";")) delimiter = ";";
  else if (first.includes(",") && !/\d[ \t]+[-+.\d]/.test(first)) return [",", false];
  if (!data.some((line) => line.includes(","))) return [delimiter, false];
  if (data.some((line) => line.includes("."))) {
    throw new InputError("it has both decimal points and commas inside its columns");
  }
  return [delimiter, true];
}

function readNumbers(data, delimiter, decimalComma) {
  const rows = data.map((line, number) => {
    const text = decimalComma ? line.replaceAll(",", ".") : line;
    return split(text, delimiter).map((field) => {
      if (!isNumber(field.trim())) {
        throw new InputError(`its line ${number + 1} of numbers holds ${JSON.stringify(field)}`);
      }
      return Number(field); // NaN of "nan" and "inf", which are refused as samples
    });
  });
  const count = rows[0].length;
  const odd = rows.findIndex((row) => row.length !== count);
  if (odd >= 0) {
    throw new InputError(`its line ${odd + 1} of numbers has ${rows[odd].length} columns, not ${count}`);
  }
  return Array.from({ length: count }, (_, column) => Float64Array.from(rows, (row) => row[column]));
}

/** The cells of a line of names, which may be divided otherwise than the numbers. */
function cells(line, delimiter) {
  const mark = [delimiter, "\t", ";", ","].find((each) => each && line.includes(each));
  return split(line, mark ?? null).map((cell) => cell.trim());
}

function split(line, delimiter) {
  return delimiter === null ? line.trim().split(/\s+/) : line.split(delimiter);
}
