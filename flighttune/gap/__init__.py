"""Why the aircraft flies otherwise than the paper's law says, and whether the certificate holds."""
