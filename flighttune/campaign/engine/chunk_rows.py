"""What a worker sends back of a chunk, as rows."""

import pyarrow as pa

from flighttune.campaign.dataset.spans import Span
from flighttune.campaign.engine.worker import FlownChunk
from flighttune.campaign.flying.rows import fallen_row
from flighttune.campaign.planning.plan import Plan
from flighttune.errors import CampaignError


def chunk_rows(plan: Plan, span: Span, chunk: FlownChunk) -> pa.Table:
    """The rows of a chunk, those of fallen runs among them, each run once and in order.

    Raises
    ------
    CampaignError
        If the worker cannot fly for the campaign, or runs are missing.
    """
    if chunk.refused:
        raise CampaignError(f"a worker cannot fly for this campaign: {chunk.refused}")
    tables = [pa.ipc.open_stream(data).read_all() for data in chunk.tables]
    tables += [fallen_row(plan, *fallen) for fallen in chunk.fallen]
    rows = pa.concat_tables(tables).sort_by("run")
    if rows.column("run").to_pylist() != list(range(*span)):
        raise CampaignError(f"runs {span.first} to {span.end - 1}: each must come back once")
    return rows
