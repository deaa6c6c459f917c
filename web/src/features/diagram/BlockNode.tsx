import { Handle, Position, type Node, type NodeProps } from "@xyflow/react";
import { memo } from "react";
import { shownScalar } from "@/shared/ui/NumberEntry";
import type { Block } from "@/shared/api/types";
import classes from "./BlockNode.module.css";
import { sizeOf } from "./layout";

export type BlockData = {
  name: string;
  title: string;
  block: Block;
  inputs: string[];
  outputs: string[];
  /** Inputs that a loop comes back to. */
  back: string[];
  problem?: string | undefined;
  warning?: string | undefined;
};
export type BlockNodeType = Node<BlockData, "block">;
export type OutputNodeType = Node<{ name: string }, "sink">;

/** A block: its name, its kind, a telling value; its ports where they are connected. */
export const BlockNode = memo(function BlockNode({ data, selected }: NodeProps<BlockNodeType>) {
  const { block, inputs, outputs, back } = data;
  const size = sizeOf(inputs.length, outputs.length, block.kind);
  if (block.kind === "sum") {
    const signs = String(block.signs ?? "++");
    return (
      <div className={classes.sum} style={size} data-selected={selected} data-problem={!!data.problem} title={data.problem ?? data.name}>
        Σ
        {inputs.map((port, i) => {
          const below = back.includes(port);
          const others = inputs.filter((p) => !back.includes(p));
          const at = below ? { left: "50%" } : { top: `${(100 * (others.indexOf(port) + 1)) / (others.length + 1)}%` };
          return (
            <Handle key={port} id={port} type="target" position={below ? Position.Bottom : Position.Left} style={at} aria-label={port}>
              <span className={below ? classes.signBelow : classes.sign}>{signs[i] === "-" ? "−" : "+"}</span>
            </Handle>
          );
        })}
        <Handle id="out" type="source" position={Position.Right} />
        <span className={classes.caption}>{data.name}</span>
      </div>
    );
  }
  const told = Object.entries(block).find(([key, value]) => key !== "kind" && key !== "role" && (typeof value === "number" || typeof value === "string" || (typeof value === "object" && value !== null && "unit" in value)));
  const row = (i: number) => size.height - 20 * Math.max(inputs.length, outputs.length, 1) + 20 * i + 6;
  return (
    <div className={classes.block} style={size} data-selected={selected} data-kind={block.kind === "input" ? "input" : block.system ? "subsystem" : "block"} data-problem={!!data.problem} data-warning={!!data.warning} title={data.problem ?? data.warning}>
      <div className={classes.name}>{data.name}</div>
      <div className={classes.kind}>{told ? `${told[0]} ${shownScalar(told[1])}` : data.title}</div>
      {inputs.map((port, i) => (
        <Handle key={port} id={port} type="target" position={Position.Left} style={{ top: row(i) }}>
          {inputs.length > 1 && <span className={classes.input}>{port}</span>}
        </Handle>
      ))}
      {outputs.map((port, i) => (
        <Handle key={port} id={port} type="source" position={Position.Right} style={{ top: row(i) }}>
          {outputs.length > 1 && <span className={classes.output}>{port.replaceAll("_", " ")}</span>}
        </Handle>
      ))}
    </div>
  );
});

export const OutputNode = memo(function OutputNode({ data, selected }: NodeProps<OutputNodeType>) {
  return (
    <div className={classes.out} data-selected={selected}>
      <Handle id="in" type="target" position={Position.Left} />
      {data.name}
    </div>
  );
});
