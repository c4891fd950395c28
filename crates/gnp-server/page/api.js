// The server's answers. Of many questions, as a drag asks them, one is under way and the newest one waits.

const RETRY_MS = [500, 1000, 2000, 3000];
// A question that is under way for longer gives way to a newer one, ms.
const PATIENCE_MS = 1500;

// What the server says is wrong (RFC 9457). `status` 0: nobody answers.
export class Problem extends Error {
  constructor(status, { title = "", detail = "", errors = [] } = {}, retryAfter = 0) {
    const said = detail || title, more = errors.map((e) => e.detail).filter((text) => text && !said.includes(text));
    super([said, ...more].filter(Boolean).join("; ") || `The server answers with status ${status}`);
    this.status = status;
    this.fields = errors.map((e) => e.field ?? "");
    this.retryAfter = retryAfter;
  }
  // Whether the same question can have an answer later.
  get passes() { return [0, 429, 502, 503, 504].includes(this.status); }
  // Which of the changes it is about, if it is about one.
  get change() {
    const found = this.fields.map((field) => /^changes\[(\d+)\]/.exec(field)).find(Boolean);
    return found ? Number(found[1]) : -1;
  }
}

const ask = async (path, { body, signal } = {}) => {
  const options = body ? { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body), signal } : { signal };
  let response;
  try {
    response = await fetch(path, options);
    if (response.ok) return await response.json();
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem(0, { detail: "The server does not answer" });
  }
  throw new Problem(response.status, await response.json().catch(() => ({})), Number(response.headers.get("Retry-After")) || 0);
};

export const model = () => ask("/v1/model");
export const recordings = () => ask("/v1/recordings");
export const tracks = (recording, query) => ask(`/v1/recordings/${encodeURIComponent(recording)}/tracks?${new URLSearchParams(query)}`);
export const predict = (body, signal) => ask("/v1/predict", { body, signal });
export const explain = (body, signal) => ask("/v1/explain", { body, signal });

export const wait = (ms) => new Promise((done) => setTimeout(done, ms));
export const patience = (failures, problem) => Math.max(RETRY_MS[Math.min(failures, RETRY_MS.length - 1)], problem.retryAfter * 1000);

// Asks `question`s by `answer(question, signal)` and tells `onAnswer(question, answer, ms)` and `onProblem(problem, question)`.
export class Newest {
  #waiting = null;
  #running = null;
  constructor(answer, { onAnswer, onProblem }) { Object.assign(this, { answer, onAnswer, onProblem }); }
  get busy() { return this.#running !== null; }
  ask(question) {
    this.#waiting = question;
    if (!this.#running) this.#work();
    else if (performance.now() - this.#running.since > PATIENCE_MS) this.#running.controller.abort();
  }
  async #work() {
    let failures = 0;
    while (this.#waiting) {
      const question = this.#waiting, controller = new AbortController();
      this.#waiting = null;
      this.#running = { controller, since: performance.now() };
      try {
        const answer = await this.answer(question, controller.signal), ms = performance.now() - this.#running.since;
        failures = 0;
        this.onAnswer(question, answer, ms);
      } catch (error) {
        if (error.name === "AbortError") continue;
        if (!(error instanceof Problem)) { this.#running = null; throw error; }
        this.onProblem(error, question);
        if (!error.passes) continue;
        await wait(patience(failures, error));
        failures += 1;
        this.#waiting ??= question;
      }
    }
    this.#running = null;
  }
}
