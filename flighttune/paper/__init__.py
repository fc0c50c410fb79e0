"""Every table and figure of arXiv 2411.13140 again, with a verdict on every claim.

The paper is "Robust Convergency Indicator using MIMO-PI Controller in the presence of
disturbances". ``parameters`` holds what it prints and what had to be assumed, ``study`` computes,
``items`` draw, ``claims`` judge, ``errata`` lists the slips and ``page`` puts all on one page.
"""
