"""The description of the interface for people: one page without scripts, that loads nothing from anywhere."""

import json
from collections.abc import Mapping
from html import escape
from typing import Any

STYLE = (
    "body{font:15px/1.5 system-ui,sans-serif;max-width:60rem;margin:2rem auto;padding:0 1rem;color:#222}"
    "h2{margin-top:2.2rem;border-bottom:2px solid #ddd}summary{cursor:pointer;padding:.3rem 0}"
    "code,pre{background:#f5f5f5;padding:.1rem .3rem}pre{overflow-x:auto;padding:.6rem;font-size:.85em}"
    "table{border-collapse:collapse;margin:.4rem 0}th,td{padding:.15rem .6rem;text-align:left;vertical-align:top;"
    "border-bottom:1px solid #e4e4e4}b.m{display:inline-block;min-width:4.2rem}section{margin-left:1rem}"
)
METHODS = ("get", "post", "put", "patch", "delete", "head", "options")


def interface_html(document: Mapping[str, Any]) -> str:
    """Render a description in OpenAPI: operations by what they are about, then the schemas."""
    groups: dict[str, list[str]] = {}
    for path, item in document["paths"].items():
        for method in METHODS:
            if method in item:
                operation = item[method]
                groups.setdefault((operation.get("tags") or ["service"])[0], []).append(
                    _operation(method, path, operation)
                )
    body = "\n".join(f"<h2>{escape(tag)}</h2>\n{''.join(found)}" for tag, found in groups.items())
    schemas = "\n".join(
        f'<details id="schema-{escape(name)}"><summary><code>{escape(name)}</code></summary>{_json(schema)}</details>'
        for name, schema in document.get("components", {}).get("schemas", {}).items()
    )
    info = document["info"]
    return f"""<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(info["title"])}</title>
<style>{STYLE}</style></head>
<body>
<h1>{escape(info["title"])} {escape(info["version"])}</h1>
<p>{escape(info.get("description", ""))}</p>
<p>For programs: <a href="openapi.json">OpenAPI 3.1</a>, <a href="openapi-3.0.json">OpenAPI 3.0</a>.</p>
{body}
<h2>Schemas</h2>
{schemas}
</body>
</html>
"""


def _operation(method: str, path: str, operation: Mapping[str, Any]) -> str:
    parameters = "".join(
        f"<tr><td><code>{escape(each['name'])}</code></td><td>{escape(each['in'])}</td>"
        f"<td>{'required' if each.get('required') else ''}</td><td>{escape(each.get('description', ''))}</td></tr>"
        for each in operation.get("parameters", ())
    )
    table = f"<table><tr><th>parameter</th><th>in</th><th></th><th></th></tr>{parameters}</table>" if parameters else ""
    answers = "".join(
        f"<tr><td>{escape(status)}</td><td>{escape(each.get('description', ''))}</td>"
        f"<td>{escape(', '.join(each.get('content', {})))}</td></tr>"
        for status, each in operation.get("responses", {}).items()
    )
    return (
        f'<details><summary><b class="m">{method.upper()}</b> <code>{escape(path)}</code> '
        f"{escape(operation.get('summary', ''))}</summary><section><p>{escape(operation.get('description', ''))}</p>"
        f"{table}{_bodies(operation)}<table><tr><th>answer</th><th></th><th>type</th></tr>{answers}</table>"
        "</section></details>\n"
    )


def _bodies(operation: Mapping[str, Any]) -> str:
    content = operation.get("requestBody", {}).get("content", {})
    return "".join(
        f"<details><summary>body as <code>{escape(kind)}</code></summary>{_json(each.get('schema', {}))}</details>"
        for kind, each in content.items()
    )


def _json(value: Any) -> str:
    return f"<pre>{escape(json.dumps(value, indent=1, ensure_ascii=False))}</pre>"
