"""Talk to a running service, as any other client would: over HTTP."""

import hmac
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Self
from urllib.parse import quote

import httpx

from service.errors import Problem
from service.names.result_lists import STREAMED
from service.use_cases.access.service_proof import CHALLENGE_HEADER, PROOF_HEADER, new_challenge, proof_of
from service.use_cases.inputs.stated_columns import HEADER

CHUNK = 1 << 20
USUAL_PORTS = {"http": 80, "https": 443}
SOONEST_S, LATEST_S, PAUSE_SHARE = 0.1, 1.0, 0.03
"""Pauses between two looks at a job: a share of how long it has taken so far, within bounds."""
Document = dict[str, Any]


class RefusedError(Exception):
    """Say that the service answered with a problem."""

    def __init__(self, problem: Problem) -> None:
        self.problem = problem
        self.status = int(problem.get("status", 500))
        faults = "".join(f"\n  {fault['pointer']}: {fault['detail']}" for fault in problem.get("errors") or [])
        super().__init__(f"{problem.get('title', 'Error')}: {problem.get('detail', '')}{faults}")


class UnreachableError(Exception):
    """Say that no service answers, or that it broke off."""

    def __init__(self, url: str, why: str) -> None:
        super().__init__(f"the service at {url} does not answer: {why}")


class ServiceClient:
    """Upload scans, start jobs, wait for them, fetch results.

    Parameters
    ----------
    url
        Of the service.
    transport
        In place of the network, for tests.
    key
        For services that want one.
    """

    def __init__(self, url: str, transport: httpx.BaseTransport | None = None, key: str | None = None) -> None:
        self.url = url.rstrip("/")
        headers = {} if key is None else {"Authorization": f"Bearer {key}"}
        # an upload is answered when the file has been inspected, which may take minutes
        self._http = httpx.Client(
            base_url=self.url, timeout=httpx.Timeout(30.0, read=600.0), transport=transport, headers=headers
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self._http.close()

    def is_tieline(self) -> bool:
        """Tell whether a Tieline service answers at the address."""
        try:
            answer = self._http.get("/", timeout=2.0, headers={"Accept": "application/json"})
            return answer.status_code == 200 and answer.json().get("title") == "Tieline"
        except (httpx.HTTPError, ValueError, AttributeError):
            return False

    def proves(self, secret: bytes | None) -> bool:
        """Tell whether who answers knows a secret that only a service of this user can know; it is not sent itself."""
        if secret is None:
            return False
        challenge = new_challenge()
        port = self._http.base_url.port or USUAL_PORTS.get(self._http.base_url.scheme)
        try:
            answer = self._http.get("/", timeout=5.0, headers={CHALLENGE_HEADER: challenge, "Authorization": ""})
        except httpx.HTTPError:
            return False
        return hmac.compare_digest(answer.headers.get(PROOF_HEADER, ""), proof_of(secret, challenge, port))

    def ready(self) -> bool:
        """Tell whether the service can take and run jobs now."""
        try:
            return self._http.get("/readyz", timeout=5.0).status_code == 200
        except httpx.HTTPError:
            return False

    def upload(
        self, path: Path, on_bytes: Callable[[int], None] = lambda _sent: None, columns: str | None = None
    ) -> Document:
        """Send a scan file.

        Parameters
        ----------
        path
            Of the file.
        on_bytes
            Hears how many bytes went out each time.
        columns
            What the columns of a text table are; None: nothing is said.

        Raises
        ------
        RefusedError
            The service cannot read it.
        UnreachableError
            The service does not answer.
        """

        def pieces() -> Iterator[bytes]:
            with path.open("rb") as file:
                while piece := file.read(CHUNK):
                    yield piece
                    on_bytes(len(piece))

        headers = {
            "Content-Type": "application/octet-stream",
            "Content-Length": str(path.stat().st_size),
            "Content-Disposition": f"attachment; filename*=UTF-8''{quote(path.name, safe='')}",
            **({} if columns is None else {HEADER: columns}),
        }
        return self._ask("POST", "/files", content=pieces(), headers=headers)

    def execute(self, process_id: str, inputs: Document, outputs: Document | None = None) -> str:
        """Start a job and give its id; `outputs` are the wanted ones, None: all.

        Raises
        ------
        RefusedError
            The inputs are wrong.
        UnreachableError
            The service does not answer.
        """
        wanted = {} if outputs is None else {"outputs": outputs}
        job = self._ask("POST", f"/processes/{process_id}/execution", json={"inputs": inputs, **wanted})
        return str(job["jobID"])

    def wait(self, job_id: str, on_progress: Callable[[int, str], None] = lambda _percent, _message: None) -> Document:
        """Wait until a job has ended and give its result document.

        Raises
        ------
        RefusedError
            The job failed or was dismissed.
        UnreachableError
            The service does not answer.
        """
        began = time.monotonic()
        while True:
            job = self._ask("GET", f"/jobs/{job_id}")
            on_progress(job["progress"], job["message"])
            if job["status"] not in {"accepted", "running"}:
                return self._ask("GET", f"/jobs/{job_id}/results")
            time.sleep(min(max(SOONEST_S, PAUSE_SHARE * (time.monotonic() - began)), LATEST_S))

    def artifacts(self, job_id: str) -> list[str]:
        """List the names of a job's downloads.

        Raises
        ------
        UnreachableError
            The service does not answer.
        """
        return [str(each["name"]) for each in self._ask("GET", f"/jobs/{job_id}/artifacts")["artifacts"]]

    def download(self, job_id: str, name: str, path: Path) -> None:
        """Write one of a job's downloads to a file.

        Raises
        ------
        UnreachableError
            The service does not answer, or breaks off.
        """
        self._save(f"/jobs/{job_id}/artifacts/{quote(name, safe='')}", path)

    def download_list(self, job_id: str, name: str, path: Path) -> None:
        """Write a list of a result to a file, one entry a line (NDJSON), as it comes.

        Raises
        ------
        UnreachableError
            The service does not answer, or breaks off.
        """
        self._save(f"/jobs/{job_id}/results/{quote(name, safe='')}{STREAMED}", path)

    def _save(self, address: str, path: Path) -> None:
        try:
            with self._http.stream("GET", address) as answer, path.open("wb") as file:
                if answer.is_error:
                    raise UnreachableError(self.url, _status_line(answer))
                for piece in answer.iter_bytes(CHUNK):
                    file.write(piece)
        except httpx.HTTPError as error:
            raise UnreachableError(self.url, str(error) or type(error).__name__) from error

    def dismiss(self, job_id: str) -> None:
        """Stop a job."""
        self._ask("DELETE", f"/jobs/{job_id}")

    def _ask(self, method: str, path: str, **what: Any) -> Document:
        try:
            answer = self._http.request(method, path, **what)
            document = answer.json() if answer.content else {}
        except httpx.HTTPError as error:
            raise UnreachableError(self.url, str(error) or type(error).__name__) from error
        except ValueError as error:
            why = _status_line(answer) if answer.is_error else "its answer is not JSON"
            raise UnreachableError(self.url, why) from error
        if answer.is_error and not document:  # a proxy says so
            raise UnreachableError(self.url, _status_line(answer))
        if answer.is_error:
            raise RefusedError(document if isinstance(document, dict) else {"status": answer.status_code})
        return document if isinstance(document, dict) else {}


def _status_line(answer: httpx.Response) -> str:
    return f"{answer.status_code} {answer.reason_phrase}"
