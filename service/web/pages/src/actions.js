// Buttons that remove or cancel, and times in the zone of the browser.
import { ask, BASE, showProblem } from "./api.js";

export function showTimes(root) {
  const language = document.documentElement.lang;
  for (const time of root.querySelectorAll("time[datetime]:not([data-shown])")) {
    time.dataset.shown = "";
    const moment = new Date(time.dateTime);
    if (isNaN(moment)) continue;
    time.title = time.textContent;
    time.textContent = moment.toLocaleString(language, { dateStyle: "medium", timeStyle: time.closest(".steps") ? "medium" : "short" });
  }
}

export function wireActions() {
  document.addEventListener("click", async (event) => {
    const button = event.target.closest("[data-delete]");
    if (!button || !window.confirm(button.dataset.really)) return;
    button.disabled = true;
    try {
      await ask("DELETE", button.dataset.delete.slice(BASE.length));
      const then = button.dataset.then;
      if (then) location.assign(then);
      else location.reload();
    } catch (error) {
      button.disabled = false;
      showProblem(document.getElementById("action-problem"), error);
    }
  });
  // a link to a document that would be a page for browsers
  document.addEventListener("click", async (event) => {
    const link = event.target.closest("a[data-json]");
    if (!link) return;
    event.preventDefault();
    const answer = await fetch(link.href, { headers: { Accept: "application/json" } });
    const address = URL.createObjectURL(await answer.blob());
    const hidden = document.createElement("a");
    hidden.href = address;
    hidden.download = link.download;
    hidden.click();
    URL.revokeObjectURL(address);
  });
}
