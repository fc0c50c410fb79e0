"""All tables and figures of arXiv 2411.13140 computed again, as files and as one page.

``items`` draw, ``errata`` lists the slips of the paper and ``reproduce`` writes all of it into one
folder; `flighttune.studies.paper` has the numbers and the verdicts.
"""
