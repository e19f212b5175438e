// Signals in text files, as data/trace_files.py reads them.

import { InputError } from "./errors.js";
import { separateTime } from "./time.js";

const MAX_HEADER = 2; // lines of names and units

/**
 * Read the columns of a text file.
 *
 * @param {ArrayBuffer} buffer - The file.
 * @param {number | null} channel - The column beside the time that is kept, from 0; null keeps all.
 * @returns {{channels: Float64Array[], rate: number | null}} rate in Hz where a column of time
 *   gives it.
 */
export function parseTable(buffer, channel = null) {
  const { comments, header, data } = divide(decodeText(buffer));
  if (data.length === 0) throw new InputError("it holds no numbers");
  if (header.length > MAX_HEADER) {
    throw new InputError(`it has ${header.length} lines of words before the numbers: begin them with #`);
  }
  const [delimiter, decimalComma] = dialect(data);
  const columns = readNumbers(data, delimiter, decimalComma);
  const lines = header.length ? header : comments.slice(-MAX_HEADER);
  const rows = lines
    .map((line) => cells(line, delimiter, columns.length))
    .filter((each) => each !== null);
  return separateTime(columns, rows[0] ?? null, rows[1] ?? null, channel);
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

/** Comments before the numbers, header, and lines of numbers. */
function divide(text) {
  const found = { comments: [], header: [], data: [] };
  for (const raw of text.replaceAll('"', "").split(/\r\n|[\n\r]/)) {
    const line = raw.trim().replace(/[;,\t ]+$/, "");
    if (/^[#%]/.test(line)) {
      if (found.data.length === 0) found.comments.push(line.replace(/^[#% \t]+/, ""));
    } else if (line) {
      (found.data.length || isNumbers(line) ? found.data : found.header).push(line);
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

/** The cells of a line if there are ``count``; names may be divided otherwise than numbers. */
function cells(line, delimiter, count) {
  const marks = [delimiter, "\t", ";", ","].filter((mark) => mark && line.includes(mark));
  for (const mark of marks.length ? marks : [null]) {
    const found = split(line, mark).map((cell) => cell.trim());
    if (found.length === count) return found;
  }
  return null;
}

function split(line, delimiter) {
  return delimiter === null ? line.trim().split(/\s+/) : line.split(delimiter);
}
