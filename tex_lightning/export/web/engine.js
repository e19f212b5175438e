// The page's side of worker.js.

/** Calls actions of the worker, one promise each. */
export class Engine {
  #worker = new Worker(new URL("./worker.js", import.meta.url), { type: "module" });
  #waiting = new Map();
  #count = 0;

  constructor() {
    this.#worker.onmessage = ({ data: { id, result, error } }) => {
      const { resolve, reject } = this.#waiting.get(id);
      this.#waiting.delete(id);
      if (error === undefined) resolve(result);
      else reject(new Error(error));
    };
    this.#worker.onerror = (event) => {
      for (const { reject } of this.#waiting.values()) {
        reject(new Error(event.message || "the network could not be started"));
      }
      this.#waiting.clear();
    };
  }

  /** Load the network. */
  load(model, runtime) {
    return this.#call("load", { model, runtime });
  }

  /** Run it on ``{name: {type, data, dims}}``. */
  run(feeds) {
    return this.#call("run", feeds);
  }

  #call(action, argument) {
    const id = this.#count++;
    return new Promise((resolve, reject) => {
      this.#waiting.set(id, { resolve, reject });
      this.#worker.postMessage({ id, action, argument });
    });
  }
}
