"""Long work, through DBOS (https://docs.dbos.dev): the only package that knows the job engine."""
