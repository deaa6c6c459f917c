import { infiniteQueryOptions } from "@tanstack/react-query";
import { api, must } from "./client";
import type { components } from "./schema";

export type Comment = components["schemas"]["CommentReply"];

/** Characters of a comment. */
export const LONGEST = 4000;

export const commentsKey = (about: string) => ["comments", about];

/** What people wrote about a thing, newest first. */
export const commentsQuery = (about: string) =>
  infiniteQueryOptions({
    queryKey: commentsKey(about),
    initialPageParam: undefined as string | undefined,
    queryFn: ({ pageParam }) => must(api.GET("/v1/comments", { params: { query: { about, limit: 50, cursor: pageParam } } })),
    getNextPageParam: (page) => page.next_cursor ?? undefined,
  });

export async function writeComment(about: string, text: string): Promise<Comment> {
  return must(api.POST("/v1/comments", { body: { about, text } }));
}

export async function deleteComment(id: string): Promise<void> {
  await must(api.DELETE("/v1/comments/{identifier}", { params: { path: { identifier: id }, header: { "If-Match": "*" } } }));
}
