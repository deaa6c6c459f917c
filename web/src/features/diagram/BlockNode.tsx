import { Handle, Position, type Node, type NodeProps } from "@xyflow/react";
import { memo } from "react";
import { shownScalar } from "@/shared/ui/NumberEntry";
import { prettyUnit, words } from "@/shared/units/format";
import type { Block } from "@/shared/api/types";
import classes from "./BlockNode.module.css";
import { portPlaces, sizeOf } from "./layout";

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
export type FrameNodeType = Node<{ name: string; title: string; width: number; height: number }, "frame">;

/** A block: its name, its kind, a telling value; its ports where they are connected. */
export const BlockNode = memo(function BlockNode({ data, selected }: NodeProps<BlockNodeType>) {
  const { block, inputs, outputs, back } = data;
  const size = sizeOf(data, block.kind);
  const at = portPlaces(data, block.kind, back);
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
  const told = telling(block);
  return (
    <div className={classes.block} style={size} data-selected={selected} data-kind={block.kind === "input" ? "input" : block.system ? "subsystem" : "block"} data-problem={!!data.problem} data-warning={!!data.warning} title={data.problem ?? data.warning ?? `${data.name}: ${data.title}`}>
      <div className={classes.name}>{data.name}</div>
      <div className={classes.kind}>{told ?? data.title}</div>
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

/** What a reader wants to see of a block without opening it: its first value; a fraction's polynomials. */
function telling(block: Block): string | undefined {
  if (Array.isArray(block.numerator) && Array.isArray(block.denominator)) return `${polynomial(block.numerator)} / ${polynomial(block.denominator)}`;
  const first = Object.entries(block).find(([key, value]) => key !== "kind" && key !== "role" && (typeof value === "number" || typeof value === "string" || (typeof value === "object" && value !== null && "unit" in value)));
  if (!first) return undefined;
  const [key, value] = first;
  const quantity = typeof value === "object" ? (value as { value: unknown; unit: string }) : undefined;
  return `${words(key)} ${quantity ? `${String(quantity.value)} ${prettyUnit(quantity.unit)}` : shownScalar(value)}`;
}

function polynomial(coefficients: unknown[]): string {
  const terms = coefficients.flatMap((coefficient, i) => {
    const power = coefficients.length - 1 - i;
    if (coefficient === 0) return [];
    const symbol = power === 0 ? "" : power === 1 ? "s" : `s${[...String(power)].map((digit) => "⁰¹²³⁴⁵⁶⁷⁸⁹"[Number(digit)]).join("")}`;
    const value = typeof coefficient === "number" ? String(coefficient) : `(${shownScalar(coefficient).replace(/^=/, "")})`;
    return [symbol && value === "1" ? symbol : value + symbol];
  });
  return terms.length === 0 ? "0" : terms.join(" + ");
}
