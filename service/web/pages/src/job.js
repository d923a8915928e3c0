// Follow a job by its events, until it ends.
import { element } from "./api.js";

export function followJob(job) {
  if (!job?.dataset.follow) return;
  const find = (name) => job.querySelector(`[data-${name}]`);
  const steps = find("steps");
  const source = new EventSource(job.dataset.follow);
  const spoken = JSON.parse(job.dataset.words);
  const known = new Map(); // of each step its line: what only counts on changes it instead of adding another
  let told = "";
  const note = (message, moment) => {
    const step = message.replace(/\d+/g, "#");
    if (known.has(step)) {
      known.get(step).textContent = message;
      return;
    }
    const text = element("span", {}, message);
    known.set(step, text);
    steps.append(element("li", { class: "info" }, element("time", { datetime: moment }, ""), " ", text));
    steps.scrollTop = steps.scrollHeight;
  };
  const take = (event) => {
    const state = JSON.parse(event.data);
    const badge = find("status");
    badge.className = `badge ${state.status}`;
    badge.textContent = spoken[state.status];
    find("percent").textContent = state.progress;
    find("progress").value = state.progress;
    if (state.message !== told) {
      told = state.message;
      find("message").textContent = told;
      if (told) note(told, state.updated || new Date().toISOString());
    }
    if (["successful", "failed", "dismissed"].includes(state.status)) {
      source.close();
      location.replace(state.status === "successful" ? job.dataset.result : location.pathname + location.search);
    }
  };
  source.addEventListener("status", take);
  source.addEventListener("progress", take);
  source.addEventListener("error", () => {
    if (source.readyState !== EventSource.OPEN) find("message").textContent = job.dataset.lost;
  });
}
