import { Handle, Position, useUpdateNodeInternals, type Node, type NodeProps } from "@xyflow/react";
import { memo, useEffect, useRef } from "react";
import { words } from "@/shared/units/format";
import type { Block } from "@/shared/api/types";
import classes from "./BlockNode.module.css";
import { portPlaces, sizeOf } from "./layout";

export type BlockData = {
  name: string;
  title: string;
  /** What is told of its values. */
  told?: string | undefined;
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
export type FrameNodeType = Node<{ name: string; title: string; width: number; height: number }, "frame">;

/** A block: its name, its kind, a telling value; its ports where they are connected. */
export const BlockNode = memo(function BlockNode({ id, data, selected }: NodeProps<BlockNodeType>) {
  const { block, inputs, outputs, back } = data;
  const size = sizeOf(data, block.kind);
  const at = portPlaces(data, block.kind, back);
  // Ports that come, go or move take their wires along: React Flow measures them once, unless it is told.
  const measured = useUpdateNodeInternals();
  const ports = JSON.stringify(at);
  const known = useRef(ports);
  useEffect(() => {
    if (known.current !== ports) measured(id);
    known.current = ports;
  }, [id, ports, measured]);
  if (block.kind === "sum") {
    const signs = String(block.signs ?? "++");
    return (
      <div className={classes.sum} style={size} data-selected={selected} data-problem={!!data.problem} data-warning={!!data.warning} title={data.problem ?? data.warning ?? data.name}>
        Σ
        {inputs.map((port, i) => {
          const below = back.includes(port);
          return (
            <Handle key={port} id={port} type="target" position={below ? Position.Bottom : Position.Left} style={below ? { left: at.inputs[i]!.x } : { top: at.inputs[i]!.y }} title={port}>
              <span className={below ? classes.signBelow : classes.sign}>{signs[i] === "-" ? "−" : "+"}</span>
            </Handle>
          );
        })}
        <Handle id="out" type="source" position={Position.Right} />
        <span className={classes.caption}>{data.name}</span>
      </div>
    );
  }
  return (
    <div className={classes.block} style={size} data-selected={selected} data-kind={block.kind === "input" ? "input" : block.system ? "subsystem" : "block"} data-problem={!!data.problem} data-warning={!!data.warning} title={data.problem ?? data.warning ?? `${data.name}: ${data.title}`}>
      <div className={classes.name}>{data.name}</div>
      <div className={classes.kind}>{data.told ?? data.title}</div>
      {inputs.map((port, i) => (
        <Handle key={port} id={port} type="target" position={Position.Left} style={{ top: at.inputs[i]!.y }} title={port}>
          {inputs.length > 1 && <span className={classes.input}>{words(port)}</span>}
        </Handle>
      ))}
      {outputs.map((port, i) => (
        <Handle key={port} id={port} type="source" position={Position.Right} style={{ top: at.outputs[i]!.y }} title={port}>
          {outputs.length > 1 && <span className={classes.output}>{words(port)}</span>}
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

/** A subsystem that stands open: a loop in its frame. */
export const FrameNode = memo(function FrameNode({ data, selected }: NodeProps<FrameNodeType>) {
  return (
    <div className={classes.frame} style={{ width: data.width, height: data.height }} data-selected={selected}>
      <span className={classes.frameName}>{data.title}</span>
    </div>
  );
});
