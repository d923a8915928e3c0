"""How probable a pose is, as clients read it."""

from typing import cast

from algorithms.evidence.place import OtherPlace, Place
from schemas.results import place as documents
from schemas.results.correspondences import Triple
from service.use_cases.documents.pose_documents import matrix_rows

MOST_PIECES, MOST_OTHERS = 10, 10


def place_document(found: Place, *, target: str, source: str) -> documents.Place:
    """Describe where the source stands.

    Parameters
    ----------
    found
        What the evidence says.
    target, source
        Names of the stations.
    """
    return documents.Place(
        probability=found.probability,
        at_most=found.at_most,
        others=[_other(each) for each in found.others[:MOST_OTHERS]],
        another_like_place=found.elsewhere,
        none_of_these=found.none,
        evidence=documents.EvidenceTerms(
            free_space=found.free_space,
            beside=found.beside,
            pieces=found.pieces,
            determined=found.determined,
            ahead=found.ahead,
            usual=found.usual,
            chosen=found.chosen,
        ),
        against=[
            documents.PieceAgainst(
                station=target if piece.in_target else source,
                centre_m=cast("Triple", tuple(piece.centre_m.tolist())),
                area_m2=piece.area_m2,
                log_odds=piece.log_odds,
            )
            for piece in found.against[:MOST_PIECES]
        ],
        calibration=documents.EvidenceCalibration(
            pairs=found.calibration.pairs,
            accepted=found.calibration.accepted,
            wrong=found.calibration.wrong,
            upper_95=found.calibration.upper_95,
        ),
    )


def _other(other: OtherPlace) -> documents.OtherPlace:
    because = f"its own evidence: log-odds of {other.log_odds:.1f} against chance"
    return documents.OtherPlace(
        target_from_source=matrix_rows(other.target_from_source), probability=other.probability, because=because
    )
