import { Alert, Button, SegmentedControl, Stack, Table, Text, Title, useComputedColorScheme } from "@mantine/core";
import { useMutation, useQuery } from "@tanstack/react-query";
import { Background, Controls, Handle, MarkerType, Position, ReactFlow, type Edge, type Node, type NodeProps } from "@xyflow/react";
import "@xyflow/react/dist/style.css";
import { useMemo } from "react";
import { useTranslation } from "react-i18next";
import { Link, useParams, useSearchParams } from "react-router";
import { api, must } from "@/shared/api/client";
import { download } from "@/shared/plots/export";
import { PageHead } from "@/shared/ui/PageHead";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import { words } from "@/shared/units/format";
import { pageOf, placed, type LineageNode, type LineageReply } from "./graph";
import classes from "./LineagePage.module.css";

const DIRECTIONS = ["both", "up", "down"] as const;
type Direction = (typeof DIRECTIONS)[number];

/** What a result was made from, back to the samples, and what was made from it. */
export function LineagePage() {
  const { t } = useTranslation();
  const { id = "" } = useParams();
  const kind = useKind();
  const [query, setQuery] = useSearchParams();
  const direction: Direction = DIRECTIONS.find((one) => one === query.get("direction")) ?? "both";
  const lineage = useQuery({
    queryKey: ["lineage", id, direction],
    queryFn: (): Promise<LineageReply> => must(api.GET("/v1/lineage/{identifier}", { params: { path: { identifier: id }, query: { direction } } })),
  });
  const bundle = useMutation({
    mutationFn: async () => {
      const content = await must(api.GET("/v1/lineage/{identifier}/bundle", { params: { path: { identifier: id }, query: { direction: direction === "down" ? "both" : direction } }, parseAs: "blob" }));
      download(`${id}.zip`, content as unknown as Blob);
    },
  });
  if (lineage.isError) return <ProblemAlert error={lineage.error} m="md" onRetry={() => void lineage.refetch()} />;
  if (!lineage.data) return null;
  const here = lineage.data.nodes.find((node) => node.id === id);
  return (
    <div className="page">
      <PageHead title={t("lineage.of", { name: here ? nameOf(here, kind(here)) : id })} doc={t("lineage.doc")}>
        <SegmentedControl size="xs" aria-label={t("lineage.direction")} value={direction} onChange={(value) => setQuery(value === "both" ? {} : { direction: value }, { replace: true, preventScrollReset: true })} data={DIRECTIONS.map((value) => ({ value, label: t(`lineage.directions.${value}`) }))} />
        <Button onClick={() => bundle.mutate()} loading={bundle.isPending} title={t("lineage.bundleDoc")}>
          {t("lineage.bundle")}
        </Button>
      </PageHead>
      <Stack gap="md">
        <ProblemAlert error={bundle.error} />
        {lineage.data.truncated && (
          <Alert color="orange" variant="outline">
            {t("lineage.truncated")}
          </Alert>
        )}
        <Graph reply={lineage.data} here={id} />
        <section>
          <Title order={2} mb="xs">
            {t("lineage.list")}
          </Title>
          <Table.ScrollContainer minWidth={640}>
            <Table data-testid="nodes">
              <Table.Thead>
                <Table.Tr>
                  <Table.Th>{t("systems.name")}</Table.Th>
                  <Table.Th>{t("jobs.kind")}</Table.Th>
                  <Table.Th>{t("lineage.madeFrom")}</Table.Th>
                  <Table.Th>{t("jobs.begun")}</Table.Th>
                </Table.Tr>
              </Table.Thead>
              <Table.Tbody>
                {lineage.data.nodes.map((node) => (
                  <Row key={node.id} node={node} reply={lineage.data} />
                ))}
              </Table.Tbody>
            </Table>
          </Table.ScrollContainer>
        </section>
      </Stack>
    </div>
  );
}

function useKind() {
  const { t } = useTranslation();
  return (node: LineageNode) => {
    const kind = t(`lineage.kinds.${node.kind}`, t(`jobs.kinds.${node.kind}`, words(node.kind)));
    const revision = node.id.split("@")[1];
    return revision ? `${kind}, ${t("system.revision", { number: revision })}` : kind;
  };
}

/** What a thing is called; jobs and kept results have no name of their own and are called by what they do. */
const nameOf = (node: LineageNode, kind: string): string => (node.name === node.kind ? kind : node.name || node.id);

function Row({ node, reply }: { node: LineageNode; reply: LineageReply }) {
  const { t } = useTranslation();
  const kind = useKind();
  const page = pageOf(node);
  const from = reply.edges.filter((edge) => edge.to === node.id).map((edge) => {
    const source = reply.nodes.find((other) => other.id === edge.from);
    return source ? nameOf(source, kind(source)) : edge.from;
  });
  return (
    <Table.Tr>
      <Table.Td>
        {page ? (
          <Text component={Link} to={page} c="var(--mantine-color-anchor)" fz="sm" fw={500}>
            {nameOf(node, kind(node))}
          </Text>
        ) : (
          <Text fz="sm">
            {nameOf(node, kind(node))} {node.exists ? "" : t("lineage.gone")}
          </Text>
        )}
      </Table.Td>
      <Table.Td>{kind(node)}</Table.Td>
      <Table.Td>{from.join(", ") || "–"}</Table.Td>
      <Table.Td>
        <When at={node.created_at} />
      </Table.Td>
    </Table.Tr>
  );
}

type LineageBox = Node<{ node: LineageNode; here: boolean; kind: string }, "thing">;

function Thing({ data }: NodeProps<LineageBox>) {
  const { node, here, kind } = data;
  const page = pageOf(node);
  const text = (
    <>
      <div className={classes.name}>{nameOf(node, kind)}</div>
      <div className={classes.kind}>{node.name === node.kind ? node.id : kind}</div>
    </>
  );
  const attributes = { className: `${classes.node} nopan`, "data-kind": node.kind, "data-here": here, "data-gone": !node.exists };
  return (
    <>
      <Handle type="target" position={Position.Left} className={classes.port!} isConnectable={false} />
      {page ? (
        <Link to={page} {...attributes}>
          {text}
        </Link>
      ) : (
        <div {...attributes}>{text}</div>
      )}
      <Handle type="source" position={Position.Right} className={classes.port!} isConnectable={false} />
    </>
  );
}

const NODES = { thing: Thing };

function Graph({ reply, here }: { reply: LineageReply; here: string }) {
  const { t } = useTranslation();
  const dark = useComputedColorScheme("light") === "dark";
  const kind = useKind();
  const { nodes, edges } = useMemo(() => {
    const places = placed(reply.nodes, reply.edges);
    const ink = dark ? "#a4abb2" : "#545b62";
    return {
      nodes: reply.nodes.map((node): LineageBox => ({ id: node.id, type: "thing", position: places.get(node.id)!, data: { node, here: node.id === here, kind: kind(node) }, focusable: false, draggable: false, connectable: false })),
      edges: reply.edges.map((edge, i): Edge => ({ id: String(i), source: edge.from, target: edge.to, label: t(`lineage.roles.${edge.role}`, edge.role), focusable: false, style: { stroke: ink }, markerEnd: { type: MarkerType.ArrowClosed, color: ink }, labelStyle: { fill: dark ? "#d6dade" : "#24292e", fontSize: 10 }, labelBgStyle: { fill: dark ? "#242424" : "#ffffff" } })),
    };
  }, [reply, here, dark, kind, t]);
  return (
    <div className={classes.canvas} data-testid="graph">
      <ReactFlow nodes={nodes} edges={edges} nodeTypes={NODES} colorMode={dark ? "dark" : "light"} fitView fitViewOptions={{ maxZoom: 1, padding: 0.1 }} minZoom={0.1} nodesFocusable={false} edgesFocusable={false} elementsSelectable={false} zoomOnScroll={false} preventScrolling={false} aria-label={t("lineage.graph")}>
        <Background />
        <Controls showInteractive={false} />
      </ReactFlow>
    </div>
  );
}
