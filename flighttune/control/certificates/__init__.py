"""Certificates of gains, made with solvers and checked without: docs/certificate.md."""
