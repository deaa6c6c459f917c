import { createBrowserRouter, Navigate } from "react-router";
import { SystemFrame } from "@/features/systems/SystemFrame";
import { SystemsPage } from "@/features/systems/SystemsPage";
import { NotFound } from "./NotFound";
import { Shell } from "./Shell";

/** Every page has its own address; what a first visit does not need is loaded when it is looked at. */
export const router = createBrowserRouter([
  {
    element: <Shell />,
    errorElement: <NotFound />,
    children: [
      { index: true, element: <Navigate to="/systems" replace /> },
      { path: "systems", element: <SystemsPage /> },
      {
        path: "systems/:id",
        element: <SystemFrame />,
        children: [
          { index: true, element: <Navigate to="panel" replace /> },
          { path: "panel", lazy: async () => ({ Component: (await import("@/features/panel/PanelPage")).PanelPage }) },
          { path: "diagram", lazy: async () => ({ Component: (await import("@/features/diagram/DiagramPage")).DiagramPage }) },
          { path: "influence", lazy: async () => ({ Component: (await import("@/features/influence/InfluencePage")).InfluencePage }) },
          { path: "optimise", lazy: async () => ({ Component: (await import("@/features/optimise/OptimisePage")).OptimisePage }) },
          { path: "revisions", lazy: async () => ({ Component: (await import("@/features/systems/RevisionsPage")).RevisionsPage }) },
        ],
      },
      { path: "compare", lazy: async () => ({ Component: (await import("@/features/compare/ComparePage")).ComparePage }) },
      { path: "jobs", lazy: async () => ({ Component: (await import("@/features/jobs/JobsPage")).JobsPage }) },
      { path: "jobs/:id", lazy: async () => ({ Component: (await import("@/features/jobs/JobPage")).JobPage }) },
      { path: "datasets", lazy: async () => ({ Component: (await import("@/features/datasets/DatasetsPage")).DatasetsPage }) },
      { path: "datasets/:id/frf", lazy: async () => ({ Component: (await import("@/features/datasets/FrfPage")).FrfPage }) },
      { path: "datasets/:id/process", lazy: async () => ({ Component: (await import("@/features/datasets/processing/ProcessPage")).ProcessPage }) },
      { path: "datasets/:id/import", lazy: async () => ({ Component: (await import("@/features/datasets/ImportPage")).ImportPage }) },
      { path: "datasets/:id", lazy: async () => ({ Component: (await import("@/features/datasets/DatasetPage")).DatasetPage }) },
      { path: "results/:id", lazy: async () => ({ Component: (await import("@/features/datasets/KeptPage")).KeptPage }) },
      { path: "lineage/:id", lazy: async () => ({ Component: (await import("@/features/lineage/LineagePage")).LineagePage }) },
      { path: "identify", lazy: async () => ({ Component: (await import("@/features/matching/IdentifyPage")).IdentifyPage }) },
      { path: "validate", lazy: async () => ({ Component: (await import("@/features/matching/ValidatePage")).ValidatePage }) },
      { path: "schedules", lazy: async () => ({ Component: (await import("@/features/schedules/SchedulesPage")).SchedulesPage }) },
      { path: "schedules/new", lazy: async () => ({ Component: (await import("@/features/schedules/ScheduleFormPage")).ScheduleFormPage }) },
      { path: "schedules/:id", lazy: async () => ({ Component: (await import("@/features/schedules/SchedulePage")).SchedulePage }) },
      { path: "schedules/:id/edit", lazy: async () => ({ Component: (await import("@/features/schedules/ScheduleFormPage")).ScheduleFormPage }) },
      { path: "rigs", lazy: async () => ({ Component: (await import("@/features/rigs/RigsPage")).RigsPage }) },
      { path: "rigs/:id", lazy: async () => ({ Component: (await import("@/features/rigs/RigPage")).RigPage }) },
      { path: "rigs/:id/measure", lazy: async () => ({ Component: (await import("@/features/rigs/MeasurePage")).MeasurePage }) },
      { path: "acquisitions/:id", lazy: async () => ({ Component: (await import("@/features/rigs/AcquisitionPage")).AcquisitionPage }) },
      { path: "access", lazy: async () => ({ Component: (await import("@/features/access/AccessPage")).AccessPage }) },
      { path: "about", lazy: async () => ({ Component: (await import("@/features/about/AboutPage")).AboutPage }) },
      { path: "*", element: <NotFound /> },
    ],
  },
]);
