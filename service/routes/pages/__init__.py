"""Pages for people, at the addresses where programs get JSON."""

from service.routes.pages import job_pages, overview, processes, sessions, stored_files

ROUTES = (*overview.ROUTES, *job_pages.ROUTES, *stored_files.ROUTES, *processes.ROUTES, *sessions.ROUTES)
