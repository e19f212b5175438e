// Arrays as numpy.save writes them.

import { InputError } from "./errors.js";

const MAGIC = [0x93, 78, 85, 77, 80, 89]; // and "NUMPY"
const TYPES = {
  f4: ["getFloat32", 4], f8: ["getFloat64", 8],
  i1: ["getInt8", 1], i2: ["getInt16", 2], i4: ["getInt32", 4], i8: ["getBigInt64", 8],
  u1: ["getUint8", 1], u2: ["getUint16", 2], u4: ["getUint32", 4], u8: ["getBigUint64", 8],
}; // prettier-ignore

/**
 * Read an array of one or two dimensions.
 *
 * @param {ArrayBuffer} buffer - The file.
 * @returns {Float64Array[]} Its channels: of a table the shorter side.
 */
export function parseNpy(buffer) {
  const { type, columnMajor, shape, start } = readHeader(buffer);
  while (shape.length > 1 && shape[0] === 1) shape.shift(); // which changes no order
  while (shape.length > 1 && shape.at(-1) === 1) shape.pop();
  const [method, width] = TYPES[type.slice(1)] ?? [];
  if (method === undefined || ![1, 2].includes(shape.length)) {
    throw new InputError(`it holds ${shape.length} dimensions of ${type}; save one or two of float32`);
  }
  const [rows, columns] = shape.length === 1 ? [1, shape[0]] : shape;
  if (buffer.byteLength - start < rows * columns * width) throw new InputError("it is truncated");
  const view = new DataView(buffer, start);
  const little = type[0] !== ">";
  const at = columnMajor ? (r, c) => c * rows + r : (r, c) => r * columns + c;
  const value = (r, c) => Number(view[method](at(r, c) * width, little));
  const make = (count, length, cell) =>
    Array.from({ length: count }, (_, k) => Float64Array.from({ length }, (_, i) => cell(k, i)));
  return rows <= columns
    ? make(rows, columns, value)
    : make(columns, rows, (k, i) => value(i, k));
}

function readHeader(buffer) {
  const bytes = new Uint8Array(buffer);
  if (!MAGIC.every((each, i) => each === bytes[i])) {
    throw new InputError("it is no array as numpy.save writes it");
  }
  const view = new DataView(buffer);
  const [from, length] =
    view.getUint8(6) === 1 ? [10, view.getUint16(8, true)] : [12, view.getUint32(8, true)];
  const header = new TextDecoder("latin1").decode(bytes.subarray(from, from + length));
  const type = /'descr':\s*'([^']+)'/.exec(header);
  const shape = /'shape':\s*\(([^)]*)\)/.exec(header);
  if (type === null || shape === null) throw new InputError("its header cannot be read");
  return {
    type: type[1],
    columnMajor: /'fortran_order':\s*True/.test(header),
    shape: shape[1].split(",").filter((each) => each.trim()).map(Number),
    start: from + length,
  };
}
