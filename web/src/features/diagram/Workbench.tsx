import { Button, Text } from "@mantine/core";
import { useReactFlow } from "@xyflow/react";
import { useEffect, useMemo, useState } from "react";
import { useTranslation } from "react-i18next";
import { useBlocker } from "react-router";
import { useStore } from "zustand";
import { useShallow } from "zustand/react/shallow";
import type { SystemDocument } from "@/shared/api/types";
import { Canvas } from "./Canvas";
import { ConflictDialog } from "./ConflictDialog";
import classes from "./DiagramPage.module.css";
import { useEdges, useNodes } from "./graph";
import { Inspector } from "./Inspector";
import { blockOf, freeName, pathsOf, portsOf, scoped, withScoped, type Catalogue, type End } from "./model";
import { Notices } from "./Notices";
import { Palette } from "./Palette";
import { QuickEntry, type Mode } from "./QuickEntry";
import { SignalPlot } from "./SignalPlot";
import { useEditor, type Point } from "./store";
import { Toolbar } from "./Toolbar";
import { FIT, useArranging } from "./useArranging";
import { useCheck } from "./useCheck";
import { useClipboard } from "./useClipboard";
import { pointerOf, useFaults } from "./useFaults";
import { useFrames } from "./useFrames";
import { split, useGestures } from "./useGestures";
import { useKeys } from "./useKeys";
import { useSaving } from "./useSaving";
import { ROOT, useView } from "./useView";

/** The diagram of a system, or of a system inside of it, with everything that edits it. */
export function Workbench({ id, catalogue, draftOf }: { id: string; catalogue: Catalogue; draftOf: string | null }) {
  const { t } = useTranslation();
  const flow = useReactFlow();
  const { document: root, places, routes } = useEditor();
  const { undo, redo } = useEditor.temporal.getState();
  const [canUndo, canRedo] = useStore(useEditor.temporal, useShallow((history) => [history.pastStates.length > 0, history.futureStates.length > 0]));
  const view = useView(root);
  const { document, scope, scopeKey, frames, selected, wire, pick, go } = view;
  const own = places[scopeKey];
  // What is being typed belongs to the system in which it was begun: whoever leaves it leaves that too.
  const [typing, setTyping] = useState<{ mode: Mode; at?: Point; from?: End | null; within: string } | null>(null);
  const quick = typing?.within === scopeKey ? typing : null;
  const setQuick = (begun: { mode: Mode; at?: Point; from?: End | null } | null) => setTyping(begun && { ...begun, within: scopeKey });
  const check = useCheck(root);
  const saving = useSaving(id);
  const { arrange, laid } = useArranging(document, scopeKey, catalogue);
  const gestures = useGestures(view, catalogue);
  const { change, add, one, deep, shown } = gestures;

  const pointer = pointerOf(scope);
  const { problems, warnings } = useFaults(check, pointer, document);
  const nodes = useNodes({ document, catalogue, places: own, problems, warnings, selected });
  const edges = useEdges({ document, catalogue, places: own, routes: routes[scopeKey], wire });
  const opened = useFrames(document, catalogue, frames, selected, wire, problems);
  useEffect(() => {
    if (opened.ready) requestAnimationFrame(() => void flow.fitView(FIT));
  }, [frames, opened.ready, flow]);

  const open = (name: string) => {
    const path = name.split(".");
    if (scoped(document, path)) go([...scope, ...path]);
  };
  const behind = () => (one && document.blocks[one] ? firstOutput(one, document, catalogue) : null);
  useKeys({
    save: saving.save,
    undo,
    redo,
    remove: gestures.remove,
    group: gestures.group,
    ungroup: gestures.ungroup,
    arrange: () => void arrange(),
    all: () => pick(...nodes.map((node) => node.id)),
    add: () => !frames && setQuick({ mode: "add", from: behind() }),
    connect: () => !frames && one && setQuick({ mode: "connect" }),
    output: () => !frames && one && setQuick({ mode: "output" }),
    find: () => setQuick({ mode: "find" }),
    frames: view.toggleFrames,
    enter: () => {
      if (one && scoped(document, one.split("."))) open(one);
      else if (one) window.document.querySelector<HTMLElement>("[data-inspector] [data-parameter] input, [data-inspector] [data-parameter] select, [data-inspector] input")?.focus();
    },
    rename: () => window.document.querySelector<HTMLInputElement>("[data-inspector] [data-name] input")?.select(),
    up: () => scope.length > 0 && go(scope.slice(0, -1), scope.at(-1)!),
    clear: () => pick(),
  });
  const blocks = useMemo(() => split(selected).blocks, [selected]);
  useClipboard({ document, selected: blocks, onCut: gestures.remove, onPaste: gestures.paste });

  const blocker = useBlocker(({ currentLocation, nextLocation }) => saving.dirty && currentLocation.pathname !== nextLocation.pathname);
  const signal = wire && ((frames ? opened.edges : edges).find((edge) => edge.id === wire)?.data?.from as string | undefined);

  return (
    <div className={classes.page}>
      <aside className={classes.palette} aria-label={t("diagram.palette")}>
        <Palette catalogue={catalogue} onAdd={(entry) => add(freeName(entry.kind, Object.keys(document.blocks)), blockOf(entry), null, null)} />
      </aside>
      <div className={classes.middle}>
        <Toolbar
          root={root.name || t("diagram.system")}
          scope={scope}
          check={check}
          saving={saving}
          frames={frames}
          grouping={!frames && blocks.size > 0}
          canUndo={canUndo}
          canRedo={canRedo}
          onGo={(to) => go(to)}
          onUndo={() => undo()}
          onRedo={() => redo()}
          onArrange={() => void arrange()}
          onFrames={view.toggleFrames}
          onGroup={gestures.group}
          onAdd={() => setQuick({ mode: "add", from: behind() })}
        />
        <div className={classes.holder} data-laid={frames || laid}>
          <div className={classes.notices}>
            <Notices draftOf={draftOf} check={check} saving={saving} notice={gestures.notice} onRead={gestures.read} onGo={go} />
          </div>
          <Canvas
            nodes={frames ? opened.nodes : nodes}
            edges={frames ? opened.edges : edges}
            fixed={frames}
            onSelect={view.select}
            onWire={view.pickWire}
            onMove={gestures.moved}
            onConnect={gestures.wired}
            onOpen={open}
            onDrop={(kind, at) => catalogue.get(kind) && add(freeName(kind, Object.keys(document.blocks)), blockOf(catalogue.get(kind)!), at, null)}
            onWanted={(at, from) => setQuick({ mode: "add", at, from })}
          />
          {Object.keys(document.blocks).length === 0 && !quick && (
            <div className={classes.empty}>
              <Text fw={600}>{t("diagram.empty")}</Text>
              <Text fz="sm">{t("diagram.emptyDoc")}</Text>
            </div>
          )}
          {quick && (
            <QuickEntry
              key={quick.mode}
              mode={quick.mode}
              document={document}
              catalogue={catalogue}
              selected={one}
              from={quick.from ?? null}
              paths={quick.mode === "find" ? pathsOf(root) : ROOT}
              onAdd={(name, block) => add(name, block, quick.at ?? null, quick.from ?? null)}
              onConnect={gestures.wired}
              onOutput={gestures.output}
              onFind={(path) => go(path.split(".").slice(0, -1), path.split(".").at(-1)!)}
              onClose={() => setQuick(null)}
            />
          )}
        </div>
        {signal && (
          <div className={classes.signal}>
            <SignalPlot document={root} from={[...scope, signal].join(".")} onClose={() => view.pickWire(null)} />
          </div>
        )}
      </div>
      <aside className={classes.inspector} aria-label={t("diagram.inspector")} data-inspector>
        <Inspector
          key={scopeKey}
          document={shown}
          catalogue={catalogue}
          selected={one?.split(".").at(-1) ?? null}
          problem={check.problem}
          pointer={pointer + pointerOf(deep).slice("/system".length)}
          onEdit={(next) => change(withScoped(document, deep, () => next))}
          onSelect={(name) => (name ? pick([...deep, name].join(".")) : pick())}
          onRename={gestures.rename}
          onRenameOutput={gestures.renameOutput}
          onEnter={(name) => go([...scope, ...deep, name])}
        />
      </aside>
      {saving.conflict && <ConflictDialog conflict={saving.conflict} busy={saving.saving} onClose={saving.later} onMerge={(merged) => saving.decide(merged, saving.conflict!)} onTakeTheirs={() => saving.takeTheirs(saving.conflict!)} />}
      {blocker.state === "blocked" && (
        <div className={classes.leave} role="alertdialog" aria-label={t("diagram.leave")}>
          <Text fz="sm">{t("diagram.leave")}</Text>
          <Button variant="default" onClick={() => blocker.reset()} autoFocus>
            {t("diagram.stay")}
          </Button>
          <Button onClick={() => blocker.proceed()}>{t("diagram.goOn")}</Button>
        </div>
      )}
    </div>
  );
}

function firstOutput(name: string, document: SystemDocument, catalogue: Catalogue): End | null {
  const port = document.blocks[name] && portsOf(document.blocks[name], catalogue).outputs[0];
  return port === undefined ? null : { block: name, port };
}
