"""The landing page for browsers."""

from html import escape

from schemas.landing import LandingPage

STYLE = (
    "body{font:16px/1.5 system-ui,sans-serif;max-width:44rem;margin:3rem auto;padding:0 1rem;color:#222}"
    "h1{margin-bottom:0}small{color:#666}li{margin:.3rem 0}code{background:#f2f2f2;padding:.1rem .3rem}"
)


def landing_html(page: LandingPage) -> str:
    """Render the links as one self-contained page."""
    links = "\n".join(
        f'<li><a href="{escape(link.href)}">{escape(link.title)}</a></li>' for link in page.links if link.rel != "self"
    )
    base = next(link.href for link in page.links if link.rel == "self")
    return f"""<!doctype html>
<html lang="en">
<head><meta charset="utf-8"><meta name="viewport" content="width=device-width"><title>{escape(page.title)}</title>
<style>{STYLE}</style></head>
<body>
<h1>{escape(page.title)}</h1>
<small>version {escape(page.version)}</small>
<p>{escape(page.description)}</p>
<p><code>curl -F scan=@first.e57 -F scan=@second.e57 {escape(base)}registrations</code></p>
<ul>
{links}
</ul>
</body>
</html>
"""
