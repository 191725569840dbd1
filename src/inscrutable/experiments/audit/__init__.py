"""An audit of two tables: what decisions tell of a secret to one who learns from data alone, without any model."""

from inscrutable.experiments.audit.pairs_audit import audit_pairs
from inscrutable.experiments.audit.results import BlockScore, PairsAudit, SecretAudit, Telling

__all__ = ["BlockScore", "PairsAudit", "SecretAudit", "Telling", "audit_pairs"]
