import { Center, Loader, MantineProvider } from "@mantine/core";
import { MutationCache, QueryCache, QueryClient, QueryClientProvider } from "@tanstack/react-query";
import { setNonce } from "get-nonce";
import { useEffect } from "react";
import { RouterProvider } from "react-router";
import { isProblem } from "@/shared/api/problem";
import { whenSignedOut } from "@/shared/api/client";
import { ProblemAlert } from "@/shared/ui/ProblemAlert";
import { router } from "./routes";
import { useVisitor } from "./session";
import { SignIn } from "./SignIn";
import { theme, variables } from "./theme";

const queries = new QueryClient({
  queryCache: new QueryCache(),
  mutationCache: new MutationCache(),
  defaultOptions: { queries: { retry: (count, error) => count < 2 && !isProblem(error), refetchOnWindowFocus: false, staleTime: 5000 } },
});
/** The policy on styles asks for it: Mantine's own, and those that keep the page behind a dialog from scrolling. */
const nonce = document.querySelector<HTMLMetaElement>('meta[name="csp-nonce"]')?.content;
if (nonce) setNonce(nonce);

export function App() {
  return (
    <MantineProvider theme={theme} cssVariablesResolver={variables} defaultColorScheme="auto" getStyleNonce={() => nonce ?? ""}>
      <QueryClientProvider client={queries}>
        <Door />
      </QueryClientProvider>
    </MantineProvider>
  );
}

function Door() {
  const visitor = useVisitor();
  useEffect(() => whenSignedOut(() => queries.setQueryData(["session"], null)), []);
  if (visitor.isPending) {
    return (
      <Center h="100vh">
        <Loader aria-label="…" />
      </Center>
    );
  }
  if (visitor.isError) return <ProblemAlert error={visitor.error} m="xl" onRetry={() => void visitor.refetch()} />;
  // The page is drawn for its address at once: a transition would draw it when there is time, and whoever types or presses
  // a key meanwhile would go on from what no longer stands in the address.
  return visitor.data ? <RouterProvider router={router} useTransitions={false} /> : <SignIn />;
}
