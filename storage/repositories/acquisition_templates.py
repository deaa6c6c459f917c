"""Measurements to be asked for again."""

from __future__ import annotations

from storage.models import AcquisitionTemplate
from storage.models.base import Document
from storage.repositories.revised import RevisedRepository


class AcquisitionTemplateRepository(RevisedRepository[AcquisitionTemplate]):
    """The templates of one workspace."""

    _row, _prefix, _name, _told_as = AcquisitionTemplate, "tpl", "acquisition_template", "template"

    def create(self, *, name: str, document: Document) -> AcquisitionTemplate:
        """Keep a template."""
        return self._add(name=name, document=document)
