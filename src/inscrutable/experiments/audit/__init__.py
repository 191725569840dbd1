"""An audit of two tables: whether decisions depend on a secret, from data alone and without a model."""

from inscrutable.experiments.audit.pairs_audit import audit_pairs
from inscrutable.experiments.audit.results import BlockScore, PairsAudit, SecretAudit, Telling

__all__ = ["BlockScore", "PairsAudit", "SecretAudit", "Telling", "audit_pairs"]
