"""Files: their list, and what is known of one."""

from fastapi import Request, Response

from service.dependencies import adapters_of
from service.routes.page_answers import PageRoute, page
from service.routes.pages.pieces_of_lists import piece_of
from service.use_cases.documents.scan_warnings import file_warnings
from service.use_cases.uploads.store_files import find_file


def list_files(request: Request) -> Response:
    """List the files of a project, newest first."""
    piece = piece_of(request)
    found, total = adapters_of(request).files.find(piece.size, piece.begin)
    return page(request, "files", {"files": found, "piece": piece.of(total)})


def show_file(request: Request) -> Response:
    """Show what a file is and which scans and photos it holds."""
    file = find_file(request.path_params["file_id"], adapters_of(request).files)
    return page(request, "file", {"file": file, "warnings": file_warnings(file)})


ROUTES = (PageRoute("/files", list_files), PageRoute("/files/{file_id}", show_file))
