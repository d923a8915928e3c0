// Targets that were found in the scans of a registration, by jobs of the process `find-targets` with the same scans.

const MOST_JOBS = 50;

async function asked(address) {
  const answer = await fetch(address, { credentials: "same-origin", headers: { Accept: "application/json" } });
  return answer.ok ? answer.json() : null;
}

// Targets by name of the station; of several jobs with a scan the newest counts.
export async function foundTargets(base, job) {
  const list = await asked(`${base}/jobs?processID=find-targets&status=successful&limit=${MOST_JOBS}`);
  const jobs = list?.jobs ?? [];
  const inputs = jobs.length ? await asked(`${base}/jobs/${encodeURIComponent(job)}/inputs`) : null;
  const open = new Map((inputs?.stations ?? []).map((station) => [scanOf(station), station.name]));
  const found = new Map();
  for (const { jobID } of jobs) {
    if (!open.size) break;
    const address = `${base}/jobs/${encodeURIComponent(jobID)}`;
    const scan = scanOf((await asked(`${address}/inputs`))?.station);
    if (!open.has(scan)) continue;
    const result = await asked(`${address}/results`);
    if (result) found.set(open.get(scan), result.targets);
    open.delete(scan);
  }
  return found;
}

const scanOf = (station) => (station?.scan?.file ? `${station.scan.file} ${station.scan.index ?? 0}` : null);
