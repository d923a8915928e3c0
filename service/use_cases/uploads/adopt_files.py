"""Carry over what earlier versions stored: one blob per file, named by the file's id."""

from service.names.content_keys import FILES, content_key, is_content
from service.ports import BlobStore, FileStore


def adopt_files(files: FileStore, blobs: BlobStore) -> int:
    """Name each blob that bears the id of its file by its content instead; give their number.

    Files of the same content share one blob from then on. Nothing else may run meanwhile.
    """
    adopted = 0
    for key in blobs.keys(FILES):
        name = key.removeprefix(FILES)
        file = None if is_content(name) else files.get(name)
        if file is not None:
            blobs.move(key, content_key(file.sha256))
            adopted += 1
    return adopted
