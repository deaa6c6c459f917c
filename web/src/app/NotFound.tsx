import { Button } from "@mantine/core";
import { useTranslation } from "react-i18next";
import { isRouteErrorResponse, Link, useRouteError } from "react-router";
import { Empty } from "@/shared/ui/Empty";

export function NotFound() {
  const { t } = useTranslation();
  const error = useRouteError();
  const detail = error && !isRouteErrorResponse(error) ? (error instanceof Error ? error.message : String(error)) : t("notFound.doc");
  return (
    <main className="page">
      <Empty
        title={error && !isRouteErrorResponse(error) ? t("problem.title") : t("notFound.title")}
        action={
          <Button component={Link} to="/systems" reloadDocument>
            {t("nav.systems")}
          </Button>
        }
      >
        {detail}
      </Empty>
    </main>
  );
}
