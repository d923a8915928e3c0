// Where the machine refuses: a person says where a station lies, by points seen in both scans or by one of the poses.
// The job is computed once more from there, judged as strictly as any other, and its document says who chose.

import { button, element } from "./panel.js";
import { norm, subtracted } from "./poses.js";
import { decimal, t } from "./words.js";

const LEAST = 3;

export class ManualHelp {
  constructor(application) {
    this.application = application;
    this.picks = []; // {target: point, source: point or null}
    this.picking = false;
    this.saved = {};
    this.opener = button(t("help.title"), () => (this.panel.hidden ? this.open() : this.close()), { "aria-expanded": "false" });
    this.list = element("ol", { class: "viewer-picks" });
    this.told = element("p", { role: "status", "aria-live": "polite" });
    this.pickButton = button(t("help.pick"), () => this.startPicking());
    this.sendPicks = button(t("help.send"), () => this.send("points"), { disabled: true });
    this.confirm = button(t("help.confirm"), () => this.send("pose"));
    this.panel = element(
      "section", { class: "viewer-help", hidden: true, "aria-label": t("help.title") },
      element("h3", { text: t("help.title") }),
      element("p", { text: t("help.text") }),
      element("div", { class: "viewer-row" }, this.pickButton, button(t("help.back"), () => this.takeBack()), this.sendPicks, this.confirm),
      this.list, this.told,
    );
  }

  get pair() { return this.application.viewer.currentPair; }

  open() {
    this.application.chooseMeasuring(false);
    if (!this.pair) {
      const { pairs } = this.application.data;
      const open = pairs.findIndex((pair) => pair.status !== "accepted");
      this.application.choosePair(open < 0 ? 0 : open);
    }
    this.panel.hidden = false;
    this.opener.setAttribute("aria-expanded", "true");
    this._show();
    this.pickButton.focus();
  }

  close() {
    this.stopPicking();
    this.panel.hidden = true;
    this.opener.setAttribute("aria-expanded", "false");
  }

  pairChanged() {
    this.stopPicking();
    this.picks = [];
    this.saved = {};
    if (!this.pair) this.panel.hidden = true;
    this._show();
  }

  startPicking() {
    if (!this.pair) return;
    this.picking = true;
    this.application.chooseBeside(null);
    this.application._cross();
    this._turn();
    this.application.canvas.focus();
  }

  stopPicking() {
    if (!this.picking) return;
    this.picking = false;
    this.application.viewer.only = null;
    this.application.viewer.setMarks([]);
    this.application._cross();
    this.application.viewer.relayout();
  }

  get _awaited() {
    const last = this.picks.at(-1);
    return last && last.source === null ? this.pair.source : this.pair.target;
  }

  // Show the scan alone in which the next point is picked, from where it was looked at last.
  _turn() {
    const { viewer } = this.application;
    if (viewer.only !== null) this.saved[viewer.only] = viewer.views.saved();
    viewer.only = this._awaited;
    viewer.relayout();
    const saved = this.saved[viewer.only];
    if (saved) viewer.views.restore(saved);
    this._marks();
    this.application.say(t("help.next", { number: this.picks.filter((pick) => pick.source).length + 1, station: viewer.only }));
    this._show();
  }

  _marks() {
    const { target, source } = this.pair;
    this.application.viewer.setMarks(this.picks.flatMap((pick, k) => [
      { station: target, point: pick.target, text: String(k + 1) },
      ...(pick.source ? [{ station: source, point: pick.source, text: String(k + 1) }] : []),
    ]));
  }

  take({ station, point }) {
    if (station !== this._awaited) return;
    const last = this.picks.at(-1);
    if (last && last.source === null) last.source = point;
    else this.picks.push({ target: point, source: null });
    this._turn();
  }

  takeBack() {
    const last = this.picks.at(-1);
    if (!last) return;
    if (last.source) last.source = null; else this.picks.pop();
    if (this.picking) this._turn(); else this._show();
  }

  _show() {
    if (!this.pair) return;
    const whole = this.picks.filter((pick) => pick.source);
    this.list.replaceChildren(...this.picks.map((pick) => element("li", {
      text: `${this.pair.target} (${pick.target.map((value) => decimal(value, 3)).join("; ")}) – ${pick.source
        ? `${this.pair.source} (${pick.source.map((value) => decimal(value, 3)).join("; ")})` : t("help.now_in", { station: this.pair.source })}`,
    })));
    let worst = 0;
    whole.forEach((a, i) => whole.slice(0, i).forEach((b) => {
      worst = Math.max(worst, Math.abs(norm(subtracted(a.target, b.target)) - norm(subtracted(a.source, b.source))));
    }));
    this.told.textContent = whole.length >= 2
      ? t("help.differ", { count: whole.length, worst: decimal(100 * worst, 1) }) : "";
    this.sendPicks.disabled = whole.length < LEAST;
    this.confirm.disabled = !this.pair.poses.length;
  }

  async send(how) {
    const { target, source, poses } = this.pair;
    const start = { target, source };
    if (how === "points") {
      start.picked_points = this.picks.filter((pick) => pick.source).map((pick) => [...pick.target, ...pick.source]);
    } else {
      start.target_from_source = poses[this.application.viewer.alternative].target_from_source;
    }
    this.told.textContent = t("help.sending");
    try {
      const asked = await fetch(`${this.application.here}/inputs`, { credentials: "same-origin", headers: { Accept: "application/json" } });
      if (!asked.ok) throw new Error(await reason(asked));
      const inputs = await asked.json();
      const others = (inputs.starts ?? []).filter((each) => each.target !== target || each.source !== source);
      const answer = await fetch(`${this.application.base}/processes/register/execution`, {
        method: "POST",
        credentials: "same-origin",
        // a session of the browser changes nothing without the word of one of the service's own pages
        headers: { "Content-Type": "application/json", Accept: "application/json", "Tieline-Page": "1" },
        body: JSON.stringify({ inputs: { ...inputs, starts: [...others, start] } }),
      });
      if (!answer.ok) throw new Error(await reason(answer));
      const job = (await answer.json()).jobID;
      this.told.replaceChildren(element("a", { href: `${this.application.base}/jobs/${encodeURIComponent(job)}`, text: t("help.runs_on") }));
      this.application.root.dataset.newJob = job;
      this.told.querySelector("a").focus();
    } catch (error) {
      this.told.textContent = error.message;
    }
  }
}

async function reason(answer) {
  const problem = await answer.json().catch(() => ({}));
  const faults = (problem.errors ?? []).map((fault) => fault.detail ?? fault.message).filter(Boolean);
  return [problem.detail ?? problem.title ?? t("help.refused", { status: answer.status }), ...faults].join(" ");
}
