"""Studies with a search or a model: meet, worst, beside, adoption, the paper."""
