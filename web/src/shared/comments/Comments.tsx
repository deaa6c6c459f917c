import { Button, Group, Stack, Text, Textarea } from "@mantine/core";
import { useInfiniteQuery, useMutation, useQueryClient } from "@tanstack/react-query";
import { useState, type FormEvent, type KeyboardEvent } from "react";
import { useTranslation } from "react-i18next";
import { commentsKey, commentsQuery, deleteComment, LONGEST, writeComment, type Comment } from "@/shared/api/comments";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { When } from "@/shared/ui/When";
import classes from "./Comments.module.css";

/** What people wrote about a thing, newest first, and a field for what is to be added; plain text, shown as it is written. */
export function Comments({ about }: { about: string }) {
  const { t } = useTranslation();
  const comments = useInfiniteQuery(commentsQuery(about));
  const found = comments.data?.pages.flatMap((page) => page.items) ?? [];
  return (
    <Stack gap="sm" maw={760} data-testid="comments">
      <Entry about={about} />
      <ProblemAlert error={comments.error} onRetry={() => void comments.refetch()} />
      {comments.isSuccess && found.length === 0 && (
        <Text fz="sm" c="dimmed">
          {t("comments.none")}
        </Text>
      )}
      {found.length > 0 && (
        <ol className={classes.list} aria-label={t("comments.title")}>
          {found.map((comment) => (
            <Said key={comment.id} about={about} comment={comment} />
          ))}
        </ol>
      )}
      {comments.hasNextPage && (
        <Button variant="default" onClick={() => void comments.fetchNextPage()} loading={comments.isFetchingNextPage} style={{ alignSelf: "flex-start" }}>
          {t("comments.older")}
        </Button>
      )}
    </Stack>
  );
}

/** The field of a new comment; what was written stays until the service has it. */
function Entry({ about }: { about: string }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const [text, setText] = useState("");
  const write = useMutation({
    mutationFn: () => writeComment(about, text),
    onSuccess: () => {
      setText("");
      return queries.invalidateQueries({ queryKey: commentsKey(about) });
    },
  });
  const send = (event: FormEvent | KeyboardEvent) => {
    event.preventDefault();
    if (text.trim() !== "" && !write.isPending) write.mutate();
  };
  return (
    <form onSubmit={send}>
      <Stack gap="xs" align="flex-start">
        <Textarea
          label={t("comments.label")}
          description={t("comments.doc")}
          value={text}
          onChange={(event) => setText(event.currentTarget.value)}
          onKeyDown={(event) => event.key === "Enter" && (event.ctrlKey || event.metaKey) && send(event)}
          maxLength={LONGEST}
          rows={3}
          resize="vertical"
          w="100%"
        />
        <ProblemAlert error={write.error} />
        <Button type="submit" variant="default" disabled={text.trim() === ""} loading={write.isPending}>
          {t("comments.write")}
        </Button>
      </Stack>
    </form>
  );
}

/** One comment; its author, or an admin, is asked once more before it is gone. */
function Said({ about, comment }: { about: string; comment: Comment }) {
  const { t } = useTranslation();
  const queries = useQueryClient();
  const [asked, setAsked] = useState(false);
  const remove = useMutation({
    mutationFn: () => deleteComment(comment.id),
    onSuccess: () => queries.invalidateQueries({ queryKey: commentsKey(about) }),
  });
  return (
    <li className={classes.said}>
      <Group gap="xs" justify="space-between">
        <Text fz="sm">
          <Text span fw={600} fz="sm" className={classes.text}>
            {comment.author}
          </Text>{" "}
          <Text span c="dimmed" fz="xs">
            <When at={comment.created_at} />
          </Text>
        </Text>
        {comment.deletable && !asked && (
          <Button size="compact-xs" variant="subtle" color="red" onClick={() => setAsked(true)} aria-label={t("comments.deleteOf", { author: comment.author })}>
            {t("systems.delete")}
          </Button>
        )}
        {asked && (
          <Group gap="xs">
            <Button size="compact-xs" color="red" onClick={() => remove.mutate()} loading={remove.isPending} autoFocus>
              {t("comments.forGood")}
            </Button>
            <Button size="compact-xs" variant="default" onClick={() => setAsked(false)}>
              {t("comments.keep")}
            </Button>
          </Group>
        )}
      </Group>
      <Text fz="sm" className={classes.text}>
        {comment.text}
      </Text>
      <ProblemAlert error={remove.error} />
    </li>
  );
}
