// Signals in text files, of what tex_lightning_runtime reads the plain kinds; others are refused.

import { InputError } from "./errors.js";
import { reasonAgainst } from "./columns.js";
import { separateTime } from "./time.js";

/**
 * Read the columns of a text file.
 *
 * @param {ArrayBuffer} buffer - The file.
 * @param {(number | string)[] | null} chosen - Numbers of axes, from 0, or names; null is all.
 * @returns {{channels: Float64Array[], rate: number | null}} rate in Hz where a column of time
 *   gives it.
 */
export function parseTable(buffer, chosen) {
  const { above, data } = divide(decodeText(buffer));
  if (data.length === 0) throw new InputError("it holds no numbers");
  const [delimiter, decimalComma] = dialect(data);
  const columns = readNumbers(data, delimiter, decimalComma);
  const names = findNames(above, delimiter, columns);
  return separateTime(columns, names, chosen, reasonAgainst);
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
  const plain = text.replace(/\0+$/, "").replace(/"([-+]?\d+),(\d+)"/g, "$1.$2");
  for (const raw of plain.replaceAll('"', "").split(/\r\n|[\n\r]/)) {
    const line = raw.trim().replace(/[;,\t ]+$/, "");
    if (!line) continue;
    if (found.data.length === 0 && !isNumbers(line)) {
      const comment = /^[#%]/.test(line);
      found.above.push({ line: line.replace(/^[#% \t]+/, ""), comment });
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

/** Names and units of the columns, in rows; none if the file has no names. */
function findNames(above, delimiter, columns) {
  const rows = [];
  for (const { line, comment } of above.toReversed()) {
    const row = cells(line, delimiter);
    if (row.length === columns.length) rows.unshift(row);
    else if (rows.length > 0) break;
    else if (!comment && (row.length > 1 || columns.length === 2)) {
      throw new InputError(`it has ${row.length} names and ${columns.length} columns`);
    }
  }
  const numbered = columns.every((column, index) => column[0] === index) && columns.length > 1;
  if (rows.length === 0 && (numbered || (delimiter === "," && inDoubt(columns)))) {
    throw new InputError("it has no line of names, and may have decimal commas; give one");
  }
  return rows;
}

/** Whether two columns of whole numbers may be one with decimal commas. */
function inDoubt(columns) {
  return columns.length === 2 && columns.every((column) => column.every(Number.isInteger));
}

/** The cells of a line of names, which may be divided otherwise than the numbers. */
function cells(line, delimiter) {
  const mark = [delimiter, "\t", ";", ","].find((each) => each && line.includes(each));
  return split(line, mark ?? null).map((cell) => cell.trim());
}

function split(line, delimiter) {
  return delimiter === null ? line.trim().split(/\s+/) : line.split(delimiter);
}
