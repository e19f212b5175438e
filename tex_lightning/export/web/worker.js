// Runs the network beside the page, so that the page goes on answering.

import * as ort from "../onnxruntime/ort.wasm.bundle.min.js";

let session = null;

self.onmessage = async ({ data: { id, action, argument } }) => {
  try {
    const [result, transfer] = await ACTIONS[action](argument);
    self.postMessage({ id, result }, transfer);
  } catch (error) {
    self.postMessage({ id, error: String(error?.message ?? error) });
  }
};

const ACTIONS = { load, run };

async function load({ model, runtime }) {
  ort.env.logLevel = "error";
  ort.env.wasm.numThreads = 1; // more would take headers that a plain file server does not send
  ort.env.wasm.wasmBinary = await fetchBytes(runtime);
  const options = { executionProviders: ["wasm"], graphOptimizationLevel: "all" };
  session = await ort.InferenceSession.create(await fetchBytes(model), options);
  return [{ inputs: session.inputNames, outputs: session.outputNames }, []];
}

async function fetchBytes(url) {
  const response = await fetch(url);
  if (!response.ok) throw new Error(`${url} cannot be fetched (${response.status})`);
  return new Uint8Array(await response.arrayBuffer());
}

async function run(feeds) {
  const tensors = Object.fromEntries(
    Object.entries(feeds).map(([name, { type, data, dims }]) => [
      name,
      new ort.Tensor(type, data, dims),
    ]),
  );
  const outputs = Object.entries(await session.run(tensors));
  const plain = outputs.map(([name, { data, dims }]) => [name, { data, dims: [...dims] }]);
  // outputs may share a buffer, and each can be handed over only once
  const transfer = [...new Set(plain.map(([, { data }]) => data.buffer))];
  return [Object.fromEntries(plain), transfer];
}
