"""From files of a reference mesh and of a subject to a file of the subject's mesh."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from fingerfit.anatomy.description import read_finger
from fingerfit.anatomy.fixtures import add_fixtures
from fingerfit.core.errors import InputError
from fingerfit.core.files import write_text
from fingerfit.deck.mesh_file import format_mesh, read_mesh
from fingerfit.imaging.pictures import read_picture
from fingerfit.morph.body import morph_body, morph_labels
from fingerfit.morph.morph import labelled, morph
from fingerfit.segment.labels import read_labels


def write_morphed(
    reference: Path,
    volume: Path,
    out: Path,
    at: Sequence[float] | None = None,
    own: Path | None = None,
    labels: Mapping[int, str] | None = None,
) -> str:
    """Bring a mesh to a subject; returns how well it fits, for a person.

    Parameters
    ----------
    reference, volume, out : Path
        Mesh, the subject's volume or segmentation, and the subject's mesh (.inp).
    at : (float, float), optional
        Where the indenter comes down, x and y, mm: the mesh is one of a finger.
    own : Path, optional
        The reference's own volume, for any other body.
    labels : mapping of int to str, optional
        Part of the mesh of each label: the volume is a segmentation.

    Raises
    ------
    FingerfitError
        For files that cannot be read or do not fit, and volumes that cannot be registered.
    """
    if out.suffix.lower() != ".inp":
        raise InputError("--out", "name", out, "one that ends in .inp")
    if at is None and (own is None) == (labels is None):
        expected = "--at of a finger; of another body --own, its volume, or --labels of a segmentation"
        raise InputError("morph", "--at, --own, --labels", "--own and --labels" if own else "none of them", expected)
    if at is not None and own is not None:
        raise InputError("morph", "--at, --own", "both", "--at of a finger, or --own of another body")
    if at is not None:
        subject = read_picture(volume)
        if labels is not None:
            subject = labelled(subject, labels)
        finger = morph(read_finger(reference), subject)
        write_text(out, format_mesh(add_fixtures(finger.mesh, at)))
        return f"{out}: {finger}"
    mesh, where = read_mesh(reference), (reference, volume)
    if labels is not None:
        body = morph_labels(mesh, read_labels(volume), labels, where=where)
    else:
        assert own is not None
        body = morph_body(mesh, read_picture(own), read_picture(volume), where=where)
    write_text(out, format_mesh(body.mesh))
    return f"{out}: {body}"
