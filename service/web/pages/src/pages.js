import "htmx.org/dist/htmx.esm.js";
import { showTimes, wireActions } from "./actions.js";
import { followJob } from "./job.js";
import { wireProcess } from "./process.js";
import { wireRegistration } from "./registration.js";

showTimes(document);
new MutationObserver((changes) => changes.forEach((change) => change.addedNodes.forEach((node) => node.querySelectorAll && showTimes(node)))).observe(document.body, { childList: true, subtree: true });
wireActions();
followJob(document.getElementById("job"));
wireProcess(document.getElementById("process-form"));
wireRegistration(document.getElementById("registration"));
