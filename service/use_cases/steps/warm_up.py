"""What computations need loaded before they begin: libraries; compiled kernels are loaded by `practice`."""


def load_for_reading() -> None:
    """Load what reading a file needs."""
    import service.formats
    import service.use_cases.steps.run_features  # noqa: F401 - loaded for the computations


def load_for_registration() -> None:
    """Load the libraries that a registration needs; starts no threads."""
    import algorithms.features.extraction
    import algorithms.registration.auto_registration
    import algorithms.registration.line_registration  # noqa: F401 - loaded for the computations
    from service.use_cases.documents import line_counts, pair_documents  # noqa: F401
    from service.use_cases.steps import link_store, run_pair, station_priors  # noqa: F401

    load_for_reading()


def load_for_reports() -> None:
    """Load what networks and reports need; the page of a report takes as long to compile as all else in it."""
    import ezdxf  # noqa: F401 - loaded for the computations
    import networkx as nx  # noqa: F401

    from schemas.requests.report_options import ReportOptions
    from service.use_cases.reports.report_page import page_template
    from service.use_cases.steps import run_network, run_network_growth, run_registration_report  # noqa: F401

    page_template(ReportOptions().lang)
